# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from ivfmc_ros.errors import CellError
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.storage.bag.reader import open_bag
from ivfmc_ros.storage.recording.image_import import brackets_by_number
from ivfmc_ros.storage.recording.image_import import ImageAtAngle
from ivfmc_ros.storage.recording.image_import import images_by_angles
from ivfmc_ros.storage.recording.image_import import images_by_number
from ivfmc_ros.storage.recording.image_import import import_images_as_bag
from ivfmc_ros.storage.scans.scan_bag import open_scan


def _paths(*names):
    return [Path(name) for name in names]


def test_number_in_the_name_is_the_step():
    steps, gaps = images_by_number(_paths('step_num12.jpg', 's3_step_num10.jpg'), -0.5)
    assert [(step.path.name, step.angle) for step in steps] == [
        ('s3_step_num10.jpg', 0.0),
        ('step_num12.jpg', -1.0),
    ]
    assert gaps == [11]


def test_last_number_tells_the_exposures_of_a_step_apart():
    names = [f'step{n}_{e}.png' for n in (3, 4, 6) for e in (20, 5)]
    steps, gaps = brackets_by_number(_paths(*names), 0.5, 2)
    assert [(at.path.name, at.angle) for at in steps] == [
        ('step3_5.png', 0.0),
        ('step3_20.png', 0.0),
        ('step4_5.png', 0.5),
        ('step4_20.png', 0.5),
        ('step6_5.png', 1.5),
        ('step6_20.png', 1.5),
    ]
    assert gaps == [5]
    with pytest.raises(FileError, match='step 3 has 2 images of 3 exposures, as 2 other steps'):
        brackets_by_number(_paths(*names), 0.5, 3)
    with pytest.raises(FileError, match=r'a1\.png: the name has no number of step and exposure'):
        brackets_by_number(_paths('a1.png'), 0.5, 2)


def test_name_without_number_is_refused():
    with pytest.raises(FileError, match=r'empty\.jpg: the name has no step number'):
        images_by_number(_paths('step1.jpg', 'empty.jpg'), 0.1)


def test_two_images_of_one_step_are_refused():
    with pytest.raises(FileError, match=r'a01\.jpg: has step number 1, as a1\.jpg'):
        images_by_number(_paths('a1.jpg', 'a01.jpg'), 0.1)


@pytest.mark.parametrize(
    ('numbers', 'step', 'problem'),
    [
        (range(1000), 1.0, r'no steps of one turn: at 1 degrees a step they are 999 degrees'),
        ([*range(9990, 10000), *range(20)], 0.01, 'a counter seems to have begun anew after 9999'),
        ([*range(101550, 101560), *range(101600, 101610)], 1.0, 'seem to be times of day'),
        ([20260130, 20260131, 20260201], 1.0, 'seem to be dates'),
    ],
)
def test_numbers_that_are_no_steps_of_one_turn_are_refused(numbers, step, problem):
    with pytest.raises(FileError, match=problem):
        images_by_number(_paths(*(f'img{n:04d}.png' for n in numbers)), math.radians(step))


def test_counter_with_gaps_is_no_fault():
    numbers = [1, 2, 5, 6, 40, 59, 99]
    steps, gaps = images_by_number(_paths(*(f'img{n}.png' for n in numbers)), math.radians(3.6))
    assert len(steps) == 7
    assert len(gaps) == 92


def test_measured_angles_are_assigned_by_name():
    steps = images_by_angles(_paths('d/a.jpg', 'd/b.jpg'), {'b.jpg': 2.0, 'a.jpg': 1.0}, Path('y'))
    assert [step.angle for step in steps] == [1.0, 2.0]


def test_images_without_angle_are_counted_and_the_first_is_named():
    with pytest.raises(FileError, match=r'y: has no angle for 2 of 3 .* the first is b\.jpg'):
        images_by_angles(_paths('a.jpg', 'b.jpg', 'c.jpg'), {'a.jpg': 1.0}, Path('y'))


@pytest.fixture
def folder(tmp_path, make_image):
    """Images of several formats: step1.jpg, step2.png, step3.bmp."""
    (tmp_path / 'in').mkdir()
    for number, suffix in enumerate(['.jpg', '.png', '.bmp'], 1):
        cv2.imwrite(str(tmp_path / 'in' / f'step{number}{suffix}'), make_image(number))
    return tmp_path / 'in'


def _steps(folder, angles):
    paths = sorted(folder.iterdir())
    return [
        ImageAtAngle(path=path, angle=angle) for path, angle in zip(paths, angles, strict=True)
    ]


def test_files_are_stored_without_encoding(folder, camera, make_image, tmp_path):
    import_images_as_bag(_steps(folder, [0.0, 0.1, 0.2]), camera, tmp_path / 'bag')
    bag = open_bag(tmp_path / 'bag')
    name = '/ivfmc/image_raw/compressed'
    read = [bag.decoder(name)(raw) for raw in bag.messages([name])]
    assert [message.format for message in read] == ['jpeg', 'png', 'png']
    for message, suffix in zip(read[:2], ['1.jpg', '2.png'], strict=True):
        assert message.data.tobytes() == (folder / f'step{suffix}').read_bytes()
    frames = list(open_scan(tmp_path / 'bag').frames())
    np.testing.assert_array_equal(frames[2].image, make_image(3))


@pytest.mark.parametrize(
    'angles', [[0.0, 0.02, 0.04], [0.3, -0.3, 7.0], [0.0, 3.6, 20.0], [1, 1, 1]]
)
def test_angle_at_the_stamp_is_exact(folder, camera, tmp_path, angles):
    import_images_as_bag(_steps(folder, angles), camera, tmp_path / 'bag', rate=5)
    frames = list(open_scan(tmp_path / 'bag').frames())
    np.testing.assert_allclose([frame.angle for frame in frames], angles, atol=1e-12)
    assert np.diff([frame.stamp_ns for frame in frames]).tolist() == [200_000_000] * 2


def test_laser_that_was_on_is_reported(folder, camera, tmp_path):
    import_images_as_bag(_steps(folder, [0, 1, 2]), camera, tmp_path / 'bag', laser='right')
    frames = open_scan(tmp_path / 'bag', lasers=('left', 'right')).frames()
    assert [frame.laser for frame in frames] == [1, 1, 1]


def test_same_images_yield_the_same_bag(folder, camera, tmp_path):
    for name in ('a', 'b'):
        import_images_as_bag(_steps(folder, [0, 1, 2]), camera, tmp_path / name)
    first, second = ((tmp_path / name / 'scan.mcap').read_bytes() for name in ('a', 'b'))
    assert first == second


def _in_12_bits(folder, make_image):
    for path in folder.iterdir():
        path.unlink()
    images = [(make_image(number).astype(np.uint16) * 257) >> 4 for number in (1, 2, 3)]
    for number, image in enumerate(images, 1):
        cv2.imwrite(str(folder / f'step{number}.png'), image)
    return images


def test_images_of_fewer_bits_are_stored_at_full_scale(folder, camera, make_image, tmp_path):
    images = _in_12_bits(folder, make_image)
    import_images_as_bag(_steps(folder, [0, 1, 2]), camera, tmp_path / 'bag', image_bits=12)
    frames = list(open_scan(tmp_path / 'bag').frames())
    for frame, image in zip(frames, images, strict=True):
        np.testing.assert_array_equal(frame.image, (image << 4) | (image >> 8))


def test_images_that_look_like_fewer_bits_are_refused(folder, camera, make_image, tmp_path):
    _in_12_bits(folder, make_image)
    with pytest.raises(ParameterError, match='the camera looks like 12 bits'):
        import_images_as_bag(_steps(folder, [0, 1, 2]), camera, tmp_path / 'bag')
    assert not (tmp_path / 'bag').exists()


def test_progress_is_reported(folder, camera, tmp_path):
    reports = []
    steps, target = _steps(folder, [0, 1, 2]), tmp_path / 'bag'
    import_images_as_bag(steps, camera, target, progress=lambda *now: reports.append(now))
    assert reports == [('import', 1, 3), ('import', 2, 3), ('import', 3, 3)]


def test_truncated_jpeg_is_named_and_nothing_is_left(folder, camera, tmp_path):
    bad = folder / 'step1.jpg'
    bad.write_bytes(bad.read_bytes()[:-20])
    with pytest.raises(FileError, match=r'step1\.jpg: the picture is cut off'):
        import_images_as_bag(_steps(folder, [0, 1, 2]), camera, tmp_path / 'bag')
    assert sorted(path.name for path in tmp_path.iterdir()) == ['in']


def test_image_of_another_size_is_named_and_nothing_is_left(folder, camera, tmp_path):
    cv2.imwrite(str(folder / 'step3.bmp'), np.zeros((50, 64), np.uint8))
    with pytest.raises(CellError, match=r'step3\.bmp: the picture is 64 x 50, .* at 64 x 48'):
        import_images_as_bag(_steps(folder, [0, 1, 2]), camera, tmp_path / 'bag')
    assert sorted(path.name for path in tmp_path.iterdir()) == ['in']


@pytest.mark.parametrize('rate', [0, -1, math.nan, math.inf])
def test_invalid_rate_is_refused(folder, camera, tmp_path, rate):
    with pytest.raises(ParameterError, match=r'rate: .* is out of range; it must be above 0'):
        import_images_as_bag(_steps(folder, [0, 1, 2]), camera, tmp_path / 'bag', rate=rate)


def test_times_in_names_are_not_steps():
    names = [f'{1_790_000_000_000_000_000 + 66_000_000 * index}.png' for index in range(5)]
    with pytest.raises(FileError, match=r'names of 5 images have numbers .* which are not steps'):
        images_by_number([Path('scan') / name for name in names], 0.1)
