# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from ivfmc_ros.calibration.boards.board import parse_board
from ivfmc_ros.calibration.boards.views import find_views
from ivfmc_ros.calibration.camera.calibrate import calibrate_camera
from ivfmc_ros.calibration.laser.calibrate import calibrate_laser
from ivfmc_ros.calibration.laser.calibrate import LaserSettings
from ivfmc_ros.calibration.report import laser_report
from ivfmc_ros.cell import transforms
from ivfmc_ros.errors import CalibrationError
from ivfmc_ros.pictures import list_pictures
from ivfmc_ros.simulation.boards.pictures import render_board
from ivfmc_ros.simulation.render.optics import Optics
from ivfmc_ros.simulation.render.optics import sheet_sigma

from ..conftest import look_at
from ..conftest import pose_matrix


def draw(folder: Path, cell, board, places, seed=0, optics=None):
    for k, (tilt, place) in enumerate(places):
        pose = pose_matrix(look_at(*tilt, place, board))
        rng = np.random.default_rng(seed + k)
        image = render_board(cell, board, pose, 0, optics=optics, rng=rng)
        cv2.imwrite(str(folder / f'{k}.png'), image)


@pytest.fixture(scope='module')
def board():
    """Squares large enough for a stripe that is wide in these small pictures."""
    return parse_board('chessboard:7x5:18mm')


@pytest.fixture(scope='module')
def rendered(tmp_path_factory, cell, board):
    folder = tmp_path_factory.mktemp('stripe')
    rng = np.random.default_rng(2)
    places = [
        (tuple(rng.uniform(-25, 25, 2)), (0.0, 0.0, float(z))) for z in np.linspace(0.34, 0.46, 7)
    ]
    draw(folder, cell, board, places)
    return find_views(board, list_pictures(folder), with_stripe=True)


def test_rendered_laser_is_found(cell, board, rendered):
    result = calibrate_laser(cell.camera, board, rendered, LaserSettings(name='left'))
    height = np.linspace(0.0, 0.1, 11)
    base = np.stack([0 * height, 0 * height, height], axis=1)
    axis = transforms.apply(cell.turntable.camera_from_base, base)
    # the laser planes of the bench cell contain the table axis
    assert np.abs(result.laser.distance(axis)).max() < 1e-4
    assert result.laser.name == 'left'
    assert result.laser.residual_rms < 1e-4
    assert result.laser.volume[0, 2] < 0.4 < result.laser.volume[1, 2]
    assert result.laser.bow is None
    assert result.inlier_fraction > 0.8


def test_thickness_of_the_light_sheet_is_measured(cell, board, rendered):
    result = calibrate_laser(cell.camera, board, rendered)
    assert result.laser.thickness == pytest.approx(
        sheet_sigma(cell, cell.lasers[0], Optics()), rel=0.05
    )
    assert laser_report(result)['thickness_m'] == result.laser.thickness


def test_thin_light_sheet_is_measured_within_15_percent(tmp_path, cell, board):
    optics = Optics(stripe_sigma=0.9)
    places = [((10.0 * k - 20.0, 12.0 - 5 * k), (0.0, 0.0, 0.34 + 0.02 * k)) for k in range(6)]
    draw(tmp_path, cell, board, places, optics=optics)
    views = find_views(board, list_pictures(tmp_path), with_stripe=True)
    result = calibrate_laser(cell.camera, board, views)
    truth = sheet_sigma(cell, cell.lasers[0], optics)
    assert result.laser.thickness == pytest.approx(truth, rel=0.15)


def test_too_few_stripes_are_refused(cell, board, rendered):
    few = replace(rendered, found=rendered.found[:4])
    with pytest.raises(CalibrationError, match=r'here: [0-4] usable pictures.*at least 5'):
        calibrate_laser(cell.camera, board, few, where='here')


def test_one_pose_is_refused(tmp_path, cell, board):
    draw(tmp_path, cell, board, [((5.0, 10.0), (0.0, 0.0, 0.4))] * 6)
    views = find_views(board, list_pictures(tmp_path), with_stripe=True)
    with pytest.raises(CalibrationError, match='nearly on one line'):
        calibrate_laser(cell.camera, board, views)


@pytest.mark.slow
def test_real_laser_rms_is_within_the_limit(data_dir):
    board = parse_board('chessboard:8x6:40mm')
    scan = data_dir / 'turntable_laser'
    camera = calibrate_camera(
        board, find_views(board, list_pictures(scan / 'chessboard')[::6])
    ).camera
    views = find_views(board, list_pictures(scan / 'chessboard_laser')[::3], with_stripe=True)
    result = calibrate_laser(camera, board, views)
    assert result.laser.residual_rms <= 0.30e-3
    assert result.laser.bow is None
    assert len(result.used) >= 15
