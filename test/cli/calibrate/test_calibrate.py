# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace
import json
import math

import cv2
import numpy as np
import pytest

from ivfmc_ros.calibration.boards.board import parse_board
from ivfmc_ros.cell.camera_file import load_camera
from ivfmc_ros.cell.camera_file import save_camera
from ivfmc_ros.cell.cell_file import CellDraft
from ivfmc_ros.cell.cell_file import load_draft
from ivfmc_ros.cell.cell_file import save_cell
from ivfmc_ros.cell.cell_file import save_draft
from ivfmc_ros.cli.main import main
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.boards.pictures import render_board
from ivfmc_ros.simulation.boards.pictures import render_platter_board
from ivfmc_ros.simulation.boards.pictures import scatter_poses

CHESSBOARD, CHARUCO = 'chessboard:7x5:17mm', 'charuco:8x6:15mm:11mm:DICT_4X4_50'


def small_cell():
    """The bench cell with pixels of twice the size."""
    bench = bench_cell()
    K = bench.camera.K / 2.0
    K[:2, 2] -= 0.25
    K[2, 2] = 1.0
    camera = type(bench.camera)(width=640, height=512, K=K, distortion=bench.camera.distortion)
    return type(bench)(camera=camera, turntable=bench.turntable, lasers=bench.lasers)


@pytest.fixture(scope='module')
def pictures(tmp_path_factory):
    """Folders of rendered pictures: camera, laser, table."""
    folder, cell, rng = tmp_path_factory.mktemp('pictures'), small_cell(), np.random.default_rng(4)
    board = parse_board(CHESSBOARD)
    for name in ('camera', 'laser', 'table'):
        (folder / name).mkdir()
    for k, pose in enumerate(scatter_poses(cell, board, 9, rng, tilt=0.8)):
        cv2.imwrite(str(folder / 'camera' / f'{k}.png'), render_board(cell, board, pose, rng=rng))
    for k, pose in enumerate(scatter_poses(cell, board, 12, rng)):
        image = render_board(cell, board, pose, 0, rng=rng)
        cv2.imwrite(str(folder / 'laser' / f'{k}.png'), image)
    for k in range(6):
        image = render_platter_board(cell, parse_board(CHARUCO), k * np.pi / 3, rng=rng)
        cv2.imwrite(str(folder / 'table' / f'{k}.png'), image)
    return folder


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """Run ivfmc calibrate in a folder of its own; returns exit code and output."""
    monkeypatch.chdir(tmp_path)
    # on a busy machine progress lines would stand before the error
    monkeypatch.setattr('ivfmc_ros.cli.support.progress.QUIET_START', math.inf)

    def call(*words):
        code = 0
        try:
            main(['calibrate', *map(str, words)])
        except SystemExit as stop:
            code = stop.code or 0
        return code, capsys.readouterr()

    return call


def test_rendered_cell_is_calibrated_from_pictures(run, pictures, tmp_path):
    cell = small_cell()
    assert run('camera', pictures / 'camera', '--board', CHESSBOARD)[0] == 0
    cam = ('--camera', 'camera.yaml', '--cell', 'cell.yaml')
    assert run('laser', pictures / 'laser', *cam, '--board', CHESSBOARD, '--name', 'left')[0] == 0
    assert run('turntable', pictures / 'table', *cam, '--board', CHARUCO)[0] == 0
    assert run('angles', pictures / 'table', *cam, '--board', CHARUCO)[0] == 0
    expected = {'camera', 'cell.left', 'cell.turntable'}
    assert {path.name for path in tmp_path.iterdir()} == {
        *(f'{stem}.png' for stem in expected),
        *(f'{stem}.report.json' for stem in expected),
        'camera.yaml',
        'cell.yaml',
        'angles.yaml',
    }
    camera = load_camera(tmp_path / 'camera.yaml')
    found = load_draft(tmp_path / 'cell.yaml').complete(camera, 'cell.yaml')
    true = cell.turntable.camera_from_base
    assert np.linalg.norm(found.turntable.camera_from_base[:3, 3] - true[:3, 3]) < 1e-3
    assert np.degrees(np.arccos(found.lasers[0].normal @ cell.lasers[0].normal)) < 0.3
    assert found.notes['board']['square_m'] == pytest.approx(0.017)
    # the doubt of the table's scale is not lost when the laser is calibrated again
    noted = load_draft(tmp_path / 'cell.yaml')
    save_draft(
        tmp_path / 'cell.yaml',
        noted.with_notes(board={**noted.notes['board'], 'scale_doubt': 0.004}),
    )
    again = (*cam, '--board', CHESSBOARD, '--name', 'left', '--exposure', 0.004)
    assert run('laser', pictures / 'laser', *again, '--temperature', 21.5)[0] == 0
    notes = load_draft(tmp_path / 'cell.yaml').notes
    assert (notes['temperature_c'], notes['exposure']) == (21.5, 0.004)
    kept = load_draft(tmp_path / 'cell.yaml').notes['board']
    assert kept['scale_doubt'] == 0.004
    assert kept['turntable_scale'] == noted.notes['board']['turntable_scale']
    assert kept['scale'] == f'the squares of {CHESSBOARD}'
    report = json.loads((tmp_path / 'cell.left.report.json').read_text())
    assert report['scale'] == f'the squares of {CHESSBOARD}'
    assert (
        'board' in found.notes['board']['turntable_scale']
        or CHARUCO in (found.notes['board']['turntable_scale'])
    )


@pytest.mark.slow
def test_folder_of_all_kinds_is_calibrated_together(run, pictures, tmp_path):
    (tmp_path / 'out').mkdir()
    wired = replace(small_cell().turntable, joint='axis_c', trigger_step=0.01)
    save_draft(tmp_path / 'out' / 'cell.yaml', CellDraft(turntable=wired, camera_frame='eye'))
    words = ('--board', CHESSBOARD, '--platter', CHARUCO, '--board-u', '0.02%', '-o', 'out')
    words = (*words, '--temperature', 22.0)
    code, written = run(pictures, *words)
    assert code == 0, written.err
    assert 'separate steps' in written.out
    assert 'not determined by the pictures: scale' in written.out
    camera = load_camera(tmp_path / 'out' / 'camera.yaml')
    found = load_draft(tmp_path / 'out' / 'cell.yaml').complete(camera, 'cell.yaml')
    cell = small_cell()
    true = cell.turntable.camera_from_base
    assert np.linalg.norm(found.turntable.camera_from_base[:3, 3] - true[:3, 3]) < 1e-3
    assert np.degrees(np.arccos(found.lasers[0].normal @ cell.lasers[0].normal)) < 0.3
    assert found.notes['temperature_c'] == 22.0
    # wiring, which no picture shows
    assert (found.turntable.joint, found.turntable.trigger_step) == ('axis_c', 0.01)
    assert found.camera_frame == 'eye'
    assert found.covariance.scale_u == pytest.approx(2e-4)
    assert camera.covariance.shape == (9, 9)
    report = json.loads((tmp_path / 'out' / 'cell.joint.report.json').read_text())
    counts = report['pictures']
    # a picture or two may be outliers of a step
    assert 18 <= counts['board'] <= 21
    assert 10 <= counts['board_with_stripe'] <= 12
    assert (counts['platter'], counts['platter_with_stripe']) == (6, 0)
    assert report['std']['fx'] > 0
    # no stripe on the platter: nothing compares the two boards
    assert report['length_over_nominal'] is None
    assert report['warnings'] == [
        line.removeprefix('warning: ')
        for line in written.out.splitlines()
        if line.startswith('warning: ')
    ]


def test_folder_without_a_laser_is_refused(run, pictures):
    words = ('--board', CHESSBOARD, '--platter', CHARUCO, '--laser', 'left')
    assert_refused(run('all', pictures, *words), 'stripe of laser left', "'left'", '--laser')


@pytest.mark.parametrize(
    ('option', 'value', 'text'),
    [
        ('--laser', 'left=', 'NAME=WORD'),
        ('--board-u', '0.5', '0.02%'),
        ('--board-u', '30%', '0.02%'),
        ('--platter', 'DICT_4X4_50', 'board'),
    ],
)
def test_options_that_are_not_understood_are_refused(run, pictures, option, value, text):
    words = {'--board': CHESSBOARD, '--platter': CHARUCO, option: value}
    given = [word for pair in words.items() for word in pair]
    assert_refused(run('all', pictures, *given), text)


@pytest.fixture
def calibrated(tmp_path):
    """A folder with a camera.yaml and a cell.yaml."""
    cell = small_cell()
    save_camera(tmp_path / 'camera.yaml', cell.camera)
    save_cell(tmp_path / 'cell.yaml', cell)
    return tmp_path


def assert_refused(outcome, *parts):
    code, written = outcome
    assert code == 1
    lines = written.err.strip().splitlines()
    assert len(lines) == 1, written.err
    assert lines[0].startswith('ivfmc: error: ')
    for part in parts:
        assert part in lines[0]


def test_empty_folder_is_refused(run, tmp_path):
    (tmp_path / 'none').mkdir()
    assert_refused(run('camera', 'none', '--board', CHESSBOARD), 'none', 'no picture')
    assert not (tmp_path / 'camera.yaml').exists()


def test_missing_folder_is_refused(run):
    assert_refused(run('camera', 'nowhere', '--board', CHESSBOARD), 'nowhere')


def test_picture_of_another_size_is_refused(run, pictures, calibrated, tmp_path):
    (tmp_path / 'mixed').mkdir()
    cv2.imwrite(str(tmp_path / 'mixed' / 'small.png'), np.zeros((48, 64), np.uint8))
    words = ('mixed', '--camera', 'camera.yaml', '--cell', 'cell.yaml')
    assert_refused(
        run('laser', *words, '--board', CHESSBOARD), 'small.png', '64 x 48', '640 x 512'
    )
    assert_refused(run('turntable', *words, '--board', CHARUCO), 'small.png')


def test_truncated_jpeg_is_refused(run, tmp_path, pictures):
    (tmp_path / 'cut').mkdir()
    image = cv2.imread(str(pictures / 'camera' / '0.png'))
    data = cv2.imencode('.jpg', image)[1].tobytes()
    (tmp_path / 'cut' / 'a.jpg').write_bytes(data[: len(data) // 2])
    assert_refused(run('camera', 'cut', '--board', CHESSBOARD), 'a.jpg', 'cut off')


def test_board_that_is_never_detected_is_refused(run, tmp_path):
    (tmp_path / 'gray').mkdir()
    cv2.imwrite(str(tmp_path / 'gray' / '1.png'), np.full((64, 64), 99, np.uint8))
    assert_refused(run('camera', 'gray', '--board', CHESSBOARD), 'gray', CHESSBOARD, '--board')


def test_too_few_views_are_refused(run, tmp_path, pictures):
    (tmp_path / 'few').mkdir()
    for k in range(3):
        (tmp_path / 'few' / f'{k}.png').write_bytes(
            (pictures / 'camera' / f'{k}.png').read_bytes()
        )
    assert_refused(run('camera', 'few', '--board', CHESSBOARD), 'few', 'at least 6')
    assert sorted(path.name for path in tmp_path.iterdir()) == ['few']


@pytest.mark.parametrize('board', ['chessboard:9x7:13', 'chess', 'charuco:8x6:15mm'])
def test_board_that_is_not_understood_is_refused(run, pictures, board):
    assert_refused(run('camera', pictures / 'camera', '--board', board), 'board')


def test_folder_to_write_to_must_exist(run, pictures):
    outcome = run('camera', pictures / 'camera', '--board', CHESSBOARD, '-o', 'no/camera.yaml')
    assert_refused(outcome, 'no/camera.yaml')


def test_stripe_pictures_need_a_laser(run, pictures, calibrated):
    draft = load_draft(calibrated / 'cell.yaml')
    save_draft(calibrated / 'bare.yaml', type(draft)(turntable=draft.turntable))
    words = ('--camera', 'camera.yaml', '--cell', 'bare.yaml', '--board', CHARUCO)
    table = pictures / 'table'
    assert_refused(
        run('turntable', table, *words, '--stripe-pictures', table), 'bare.yaml', 'lasers'
    )


def test_angles_need_a_turntable(run, pictures, calibrated):
    draft = load_draft(calibrated / 'cell.yaml')
    save_draft(calibrated / 'bare.yaml', type(draft)(lasers=draft.lasers))
    words = ('--camera', 'camera.yaml', '--cell', 'bare.yaml', '--board', CHARUCO)
    assert_refused(run('angles', pictures / 'table', *words), 'bare.yaml', 'turntable')


def test_nominal_cell_is_written_once(run, calibrated):
    words = ('nominal', '--camera', 'camera.yaml', '-o', 'first.yaml', '--distance', '400mm')
    axial = (*words, '--elevation', 20, '--aim', '45mm', '--laser', 'left:36')
    assert run(*axial)[0] == 0
    found = load_draft(calibrated / 'first.yaml')
    true = small_cell().turntable.camera_from_base
    np.testing.assert_allclose(found.turntable.camera_from_base, true, atol=1e-9)
    assert_refused(run(*axial), 'first.yaml', 'exists')


def test_nominal_paper_cell_is_written(run, calibrated):
    words = ('nominal', '--camera', 'camera.yaml', '-o', 'paper.yaml', '--distance', '400mm')
    assert run(*words, '--above', '200mm', '--tilt', 25, '--laser-height', '30mm')[0] == 0
    assert load_draft(calibrated / 'paper.yaml').lasers[0].stripe == 'columns'


def test_nominal_laser_that_is_not_understood_is_refused(run, calibrated):
    words = ('nominal', '--camera', 'camera.yaml', '-o', 'x.yaml', '--distance', '400mm')
    assert_refused(run(*words, '--elevation', 20, '--laser', 'left'), 'left')
