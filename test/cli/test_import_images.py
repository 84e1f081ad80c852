# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import math

from click.testing import CliRunner
import cv2
import numpy as np
import pytest

from ivfmc_ros.angles import save_angles
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.cell.camera_file import save_camera
from ivfmc_ros.cli.import_images import import_images
from ivfmc_ros.cli.main import main
from ivfmc_ros.errors import CellError
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.storage.scans.scan_bag import open_scan


@pytest.fixture
def place(tmp_path):
    """Folder with camera.yaml and the pictures in/step_num{1,2,4}.jpg."""
    K = np.array([[90.0, 0, 31.5], [0, 90.0, 23.5], [0, 0, 1]])
    camera = Camera(width=64, height=48, K=K, distortion=np.zeros(5))
    save_camera(tmp_path / 'camera.yaml', camera)
    (tmp_path / 'in').mkdir()
    for number in (1, 2, 4):
        image = np.full((48, 64, 3), 10 * number, np.uint8)
        cv2.imwrite(str(tmp_path / 'in' / f'step_num{number}.jpg'), image)
    return tmp_path


def _run(place, *options, folder='in'):
    arguments = [str(place / folder), '--camera', str(place / 'camera.yaml')]
    output = ['-o', str(place / 'bag')]
    return CliRunner().invoke(import_images, [*arguments, *output, *map(str, options)])


def _angles(place):
    frames = open_scan(place / 'bag').frames()
    return [math.degrees(frame.angle) for frame in frames]


def _refused(place, result, kind, problem):
    assert isinstance(result.exception, kind), result.output
    assert problem in str(result.exception)
    assert not (place / 'bag').exists()


def test_pictures_become_a_bag_and_gaps_are_told(place):
    result = _run(place, '--step', 1.5)
    assert result.exit_code == 0, result.exception
    assert result.stdout.strip().endswith(
        'bag: 3 pictures from 0.000 to 4.500 degrees; 1 steps have no picture (3)'
    )
    np.testing.assert_allclose(_angles(place), [0, 1.5, 4.5])


def test_clockwise_counts_down(place):
    assert _run(place, '--step', 1.5, '--direction', 'cw').exit_code == 0
    np.testing.assert_allclose(_angles(place), [0, -1.5, -4.5])


def test_measured_angles_are_used(place):
    names = ('step_num1.jpg', 'step_num2.jpg', 'step_num4.jpg', 'other.jpg')
    save_angles(place / 'angles.yaml', dict(zip(names, (0.1, 0.2, 0.5, 9), strict=True)))
    assert _run(place, '--angles', place / 'angles.yaml').exit_code == 0
    np.testing.assert_allclose(np.radians(_angles(place)), [0.1, 0.2, 0.5])


def test_picture_without_measured_angle_is_named(place):
    save_angles(place / 'angles.yaml', {'step_num1.jpg': 0.1})
    result = _run(place, '--angles', place / 'angles.yaml')
    _refused(place, result, FileError, 'has no angle for 2 of 3 images, the first is step_num2')


def test_bag_is_put_here_unless_told(place, monkeypatch):
    monkeypatch.chdir(place)
    result = CliRunner().invoke(import_images, ['in', '--camera', 'camera.yaml', '--step', '1'])
    assert result.exit_code == 0
    assert open_scan(place / 'in_bag').frame_count == 3


@pytest.mark.parametrize(
    ('options', 'problem'),
    [
        ((), 'give --step or --angles: one of them must say'),
        (('--step', 1, '--angles', 'a.yaml'), 'give one'),
        (('--direction', 'cw', '--angles', 'a.yaml'), '--direction belongs to --step'),
        (('--step', 0), '--step: 0 deg must be positive'),
        (('--step', -1), '--step: -1 deg must be positive; use --direction'),
        (('--step', 1, '--rate', 0), 'rate: 0.0 is out of range; it must be above 0'),
    ],
)
def test_option_that_makes_no_sense_is_named(place, options, problem):
    _refused(place, _run(place, *options), ParameterError, problem)


def test_step_that_is_no_number_is_named(place):
    result = _run(place, '--step', 'nan')
    assert result.exit_code == 2
    assert "'nan' is not an angle" in result.output


def test_empty_folder_is_named(place):
    (place / 'empty').mkdir()
    result = _run(place, '--step', 1, folder='empty')
    _refused(place, result, FileError, 'empty: holds no picture')


def test_missing_folder_is_named(place):
    result = _run(place, '--step', 1, folder='none')
    _refused(place, result, FileError, 'none: the folder cannot be read')


def test_missing_camera_is_named(place):
    (place / 'camera.yaml').unlink()
    _refused(place, _run(place, '--step', 1), CellError, 'camera.yaml: cannot be read')


def test_picture_of_another_size_is_named(place):
    cv2.imwrite(str(place / 'in' / 'step_num3.png'), np.zeros((10, 64), np.uint8))
    result = _run(place, '--step', 1)
    _refused(place, result, CellError, 'step_num3.png: the picture is 64 x 10')


def test_existing_bag_is_kept(place):
    assert _run(place, '--step', 1).exit_code == 0
    before = (place / 'bag' / 'scan.mcap').read_bytes()
    result = _run(place, '--step', 2)
    assert 'bag: exists already and is not overwritten' in str(result.exception)
    assert (place / 'bag' / 'scan.mcap').read_bytes() == before


def test_truncated_jpeg_ends_in_one_line_and_exit_code_1(place, capfd):
    bad = place / 'in' / 'step_num2.jpg'
    bad.write_bytes(bad.read_bytes()[:200])
    arguments = ['--camera', str(place / 'camera.yaml'), '--step', '1', '-o', str(place / 'bag')]
    with pytest.raises(SystemExit) as ended:
        main(['import-images', str(place / 'in'), *arguments])
    assert ended.value.code == 1
    last = capfd.readouterr().err.splitlines()[-1]
    assert last.startswith(f'ivfmc: error: {bad}: the picture is cut off after 200 bytes')
    assert sorted(path.name for path in place.iterdir()) == ['camera.yaml', 'in']


def test_measured_pictures_become_a_bag(data_dir, tmp_path):
    objects = data_dir / 'turntable_laser' / 'object'
    K = np.array([[600.0, 0, 320], [0, 600, 240], [0, 0, 1]])
    camera = Camera(width=640, height=480, K=K, distortion=np.zeros(5))
    save_camera(tmp_path / 'camera.yaml', camera)
    arguments = [str(objects), '--camera', str(tmp_path / 'camera.yaml'), '--step', '1.125']
    result = CliRunner().invoke(import_images, [*arguments, '-o', str(tmp_path / 'bag')])
    assert result.stdout.strip().endswith('bag: 320 pictures from 0.000 to 358.875 degrees')
    frames = open_scan(tmp_path / 'bag').frames()
    angles = [frame.angle for frame in frames]
    np.testing.assert_allclose(np.degrees(angles), np.arange(320) * 1.125, atol=1e-9)
