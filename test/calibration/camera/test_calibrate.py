# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ivfmc_ros.calibration.boards.board import Corners
from ivfmc_ros.calibration.boards.board import parse_board
from ivfmc_ros.calibration.boards.board_shape import BoardShape
from ivfmc_ros.calibration.boards.views import BoardView
from ivfmc_ros.calibration.boards.views import find_views
from ivfmc_ros.calibration.camera.calibrate import calibrate_camera
from ivfmc_ros.errors import CalibrationError
from ivfmc_ros.pictures import list_pictures

from ..conftest import corners_at
from ..conftest import look_at


def test_exact_corners_reproduce_the_camera(cell, board, make_views):
    result = calibrate_camera(board, make_views(noise=0.0))
    np.testing.assert_allclose(result.camera.K, cell.camera.K, atol=1e-3)
    assert result.rms < 1e-5


def test_stated_standard_deviations_match_the_errors(cell, board, make_views):
    errors, stated = [], []
    for seed in range(8):
        result = calibrate_camera(board, make_views(noise=0.05, seed=seed), fit_bend=False)
        errors.append(result.camera.K[0, 0] - cell.camera.K[0, 0])
        stated.append(result.std['fx'])
    assert 0.5 < np.std(errors) / np.mean(stated) < 2.0


def test_bad_views_are_dropped_and_named(board, make_views):
    views = make_views()
    bad = views.found[3]
    rng = np.random.default_rng(1)
    disturbed = Corners(
        ids=bad.corners.ids, uv=bad.corners.uv + rng.normal(0, 1, bad.corners.uv.shape)
    )
    found = list(views.found)
    found[3] = BoardView(path=bad.path, corners=disturbed)
    result = calibrate_camera(board, replace(views, found=tuple(found), missed=(Path('a/x.png'),)))
    assert result.dropped == {
        'pictures/3.png': 'large residuals',
        'a/x.png': 'board not detected',
    }


def test_bent_board_is_detected(cell, board, make_views):
    bend = BoardShape(
        center=BoardShape.flat(board).center, coefficients=np.array([0.02, 0.0, -0.15, 0.002])
    )
    result = calibrate_camera(board, make_views(corners_xyz=bend.corners_xyz(board)))
    np.testing.assert_allclose(result.board_shape.coefficients[:3], [0.02, 0, -0.15], atol=0.02)
    assert abs(result.board_shape.stretch - 0.002) < 2e-4
    assert abs(result.camera.K[0, 0] - cell.camera.K[0, 0]) < 2.0
    assert any('bent' in text for text in result.warnings)
    assert any('longer' in text for text in result.warnings)


def test_flat_board_stays_flat(board, make_views):
    assert calibrate_camera(board, make_views()).board_shape.is_flat


@pytest.mark.slow
def test_rational_model_fits_too(board, make_views):
    result = calibrate_camera(board, make_views(), 'rational_polynomial')
    assert result.camera.distortion.shape == (8,)
    assert result.rms < 0.06


def test_partial_views_are_used(board, make_views):
    views = make_views()
    keep = np.arange(len(board.corners_xyz)) < 30
    found = tuple(BoardView(path=v.path, corners=v.corners.select(keep)) for v in views.found[:8])
    result = calibrate_camera(board, replace(views, found=found + views.found[8:]))
    assert len(result.used) == len(views.found)


def test_uncovered_image_corners_give_a_warning(board, make_views):
    assert calibrate_camera(board, make_views()).warnings == ()
    views = make_views()
    found = tuple(v for v in views.found if (v.corners.uv > (160, 128)).any(axis=1).all())
    warnings = calibrate_camera(board, replace(views, found=found)).warnings
    assert len(warnings) == 1
    assert 'upper left of the image' in warnings[0]


def test_too_few_views_are_refused(board, make_views):
    views = make_views()
    with pytest.raises(CalibrationError, match=r'somewhere: 5 usable pictures.*at least 6'):
        calibrate_camera(board, replace(views, found=views.found[:5]), where='somewhere')


def test_parallel_views_are_refused(cell, board, make_views):
    rng = np.random.default_rng(0)
    found = tuple(
        BoardView(
            path=Path(f'{k}.png'),
            corners=corners_at(
                cell.camera,
                board.corners_xyz,
                look_at(0, 0, (0, 0, 0.35 + 0.01 * k), board),
                0.05,
                rng,
            ),
        )
        for k in range(10)
    )
    with pytest.raises(CalibrationError, match='too parallel'):
        calibrate_camera(board, replace(make_views(), found=found))


def test_unknown_model_is_refused(board, make_views):
    with pytest.raises(CalibrationError, match='fisheye'):
        calibrate_camera(board, make_views(), 'fisheye')


@pytest.mark.slow
def test_real_camera_rms_is_within_the_limit(data_dir):
    board = parse_board('chessboard:8x6:40mm')
    pictures = list_pictures(data_dir / 'turntable_laser' / 'chessboard')[::6]
    result = calibrate_camera(board, find_views(board, pictures))
    assert result.rms <= 0.20
    assert len(result.used) >= 0.8 * len(pictures)
