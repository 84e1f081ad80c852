# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from ivfmc_ros.calibration.boards.board import parse_board
from ivfmc_ros.calibration.boards.markers import parse_markers
from ivfmc_ros.calibration.laser.depth import depth_warning
from ivfmc_ros.calibration.turntable.angles import collect_angles
from ivfmc_ros.calibration.turntable.angles import fill_gaps
from ivfmc_ros.calibration.turntable.axis import CornerObservations
from ivfmc_ros.calibration.turntable.axis import PlatterPoints
from ivfmc_ros.calibration.turntable.calibrate import calibrate_turntable
from ivfmc_ros.calibration.turntable.calibrate import estimate_axis
from ivfmc_ros.calibration.turntable.calibrate import measure_angles
from ivfmc_ros.calibration.turntable.observations import detect_targets
from ivfmc_ros.calibration.turntable.observations import focal_lengths
from ivfmc_ros.calibration.turntable.observations import PlatterViews
from ivfmc_ros.calibration.turntable.platter_stripes import PlatterStripes
from ivfmc_ros.calibration.turntable.scale import scale_warnings
from ivfmc_ros.calibration.turntable.scale import ScaleCheck
from ivfmc_ros.cell import transforms
from ivfmc_ros.errors import CalibrationError
from ivfmc_ros.errors import FileError
from ivfmc_ros.simulation.boards.pictures import render_platter_board

MARKERS = parse_markers('DICT_4X4_50:20mm')
SPOTS = ((0.06, 0.0, 0.3), (0.0, 0.055, 1.0), (-0.06, 0.01, 2.0), (0.01, -0.06, -1.0))


def marker_views(cell, angles, *, side=0.02, noise=0.05, tilt=(0.0, 0.0), hidden=()):
    """Exact observations of four markers on the platter, plus noise."""
    rng = np.random.default_rng(0)
    rows = []
    for picture, angle in enumerate(angles):
        for group, (x, y, yaw) in enumerate(SPOTS):
            if (picture, group) in hidden:
                continue
            local = MARKERS.corners_xyz * (side / MARKERS.side)
            points = local @ transforms.rotation_z(yaw).T + (x, y, 0.0)
            points[:, 2] += points[:, :2] @ np.array(tilt)
            uv = cell.camera.project(cell.turntable.to_camera(points, angle))
            uv += noise * rng.standard_normal(uv.shape)
            rows.append((picture, group, uv))
    count = len(rows)
    pixels = np.concatenate([uv for *_, uv in rows])
    observations = CornerObservations(
        picture=np.repeat([r[0] for r in rows], 4),
        group=np.repeat([r[1] for r in rows], 4),
        corner=np.tile(np.arange(4), count),
        local_xyz=np.tile(MARKERS.corners_xyz, (count, 1)),
        uv=cell.camera.rays(pixels)[:, :2] * focal_lengths(cell.camera),
        bloom_jacobian=np.zeros_like(pixels),
    )
    pictures = tuple(Path(f'{k}.png') for k in range(len(angles)))
    return PlatterViews(
        target=MARKERS,
        pictures=pictures,
        missed=(),
        observations=observations,
        pixels=pixels,
        ids=(1, 2, 3, 4),
    )


def calibrated(cell, views, stripes=None):
    first, _ = estimate_axis(cell.camera, views, 'here')
    return calibrate_turntable(cell.camera, views, first, stripes, where='here')


ANGLES = np.linspace(0, 2 * np.pi, 16, endpoint=False)


def moved(cell, result):
    """The transform from the true base to the estimated one."""
    return transforms.invert(cell.turntable.camera_from_base) @ result.turntable.camera_from_base


def test_markers_give_the_axis(cell):
    result = calibrated(cell, marker_views(cell, ANGLES))
    error = moved(cell, result)
    assert np.linalg.norm(error[:3, 3]) < 0.2e-3
    assert np.abs(error[:3, :3] - np.eye(3)).max() < 1e-3
    assert result.scale_source == 'markers'
    assert result.wobble < 1e-3
    np.testing.assert_allclose(list(result.angles.values()), ANGLES, atol=2e-3)


def test_stated_standard_deviations_match_the_errors(cell):
    result = calibrated(cell, marker_views(cell, ANGLES))
    error = moved(cell, result)
    seen = np.array([-error[1, 2], error[0, 2], *error[:3, 3]])
    ratio = seen / np.sqrt(np.diag(result.adjusted.covariance))
    assert 0.2 < np.sqrt(np.mean(ratio**2)) < 2.5


def test_sense_of_rotation_is_reported(cell):
    assert calibrated(cell, marker_views(cell, ANGLES)).turns_positive
    assert not calibrated(cell, marker_views(cell, -ANGLES)).turns_positive


def test_tilt_of_the_platter_is_reported(cell):
    result = calibrated(cell, marker_views(cell, ANGLES, tilt=(0.005, 0.0)))
    assert result.wobble == pytest.approx(0.005, abs=5e-4)


def test_stripe_on_the_platter_gives_the_scale(cell):
    # markers 2 % smaller than their nominal size
    views = marker_views(cell, ANGLES, side=0.0196)
    x = np.linspace(-0.05, 0.05, 200)
    platter = transforms.apply(
        cell.turntable.camera_from_base, np.stack([x, 0.5 * x, 0 * x], axis=1)
    )
    platter_points = PlatterPoints(points_xyz=platter, sigma=np.full(200, 2e-5))
    stripes = PlatterStripes(
        pictures=(Path('0.png'),),
        picture=np.zeros(200, int),
        uv=np.zeros((200, 2)),
        platter_points=platter_points,
        pixel_sigma=np.array([0.1]),
    )
    by_markers = calibrated(cell, views)
    result = calibrated(cell, views, stripes)
    assert abs(moved(cell, by_markers)[2, 3]) > 1e-3
    assert np.linalg.norm(moved(cell, result)[:3, 3]) < 0.3e-3
    assert result.scale == pytest.approx(0.98, abs=2e-3)
    assert result.scale_source == 'laser'
    assert result.platter_rms < 1e-4


def stripe_on_platter(cell, sigma=2e-5, count=200):
    x = np.linspace(-0.05, 0.05, count)
    platter = transforms.apply(
        cell.turntable.camera_from_base, np.stack([x, 0.5 * x, 0 * x], axis=1)
    )
    return PlatterStripes(
        pictures=(Path('0.png'),),
        picture=np.zeros(count, int),
        uv=np.zeros((count, 2)),
        platter_points=PlatterPoints(points_xyz=platter, sigma=np.full(count, sigma)),
        pixel_sigma=np.array([0.1]),
    )


def test_contradicting_lengths_are_said_with_their_consequence(cell):
    views = marker_views(cell, ANGLES, side=0.0196)
    result = calibrated(cell, views, stripe_on_platter(cell))
    assert result.scale_check.is_doubtful
    (text,) = scale_warnings(result.scale_check, result.scale_source, MARKERS)
    error = 100 * abs(result.scale - 1)
    assert f'{error:.2f} mm in 100 mm' in text
    assert 'too small' in text
    assert 'caliper' in text


@pytest.mark.parametrize('height', [-1, 1])
def test_stated_uncertainty_of_the_scale_covers_an_error_of_the_height(cell, height):
    # all points are off by one sigma of the mean: the error that the laser plane makes
    sigma, count = 2e-3, 200
    stripes = stripe_on_platter(cell, sigma, count)
    up = cell.turntable.camera_from_base[:3, 2]
    points = stripes.platter_points.points_xyz + height * sigma / np.sqrt(count) * up
    off = replace(stripes, platter_points=replace(stripes.platter_points, points_xyz=points))
    views = marker_views(cell, ANGLES)
    wrong, right = (calibrated(cell, views, s).scale_check for s in (off, stripes))
    assert abs(wrong.ratio - right.ratio) == pytest.approx(right.u, rel=0.25)
    assert not wrong.is_doubtful


def test_scale_that_nothing_measured_has_no_check(cell):
    result = calibrated(cell, marker_views(cell, ANGLES))
    assert result.scale_check is None
    (text,) = scale_warnings(None, result.scale_source, MARKERS)
    assert '1 mm in 100 mm' in text
    assert '--stripe-pictures' in text


@pytest.mark.parametrize(
    ('ratio', 'u', 'words'),
    [
        (1.0048, 0.0010, ['0.48 % too large', '0.48 mm in 100 mm']),
        (0.9952, 0.0010, ['0.48 % too small']),
        (1.0048, 0.0025, []),
        (1.0004, 0.0001, []),
        (1.0006, 0.0001, ['0.06 mm in 100 mm']),
        (1.0, 0.0040, ['U = 0.0080', '0.8 mm in 100 mm']),
        (float('nan'), 0.001, ['scale']),
    ],
)
def test_scale_is_doubted_by_its_own_uncertainty_and_a_least_difference(ratio, u, words):
    found = scale_warnings(ScaleCheck(ratio=ratio, u=u), 'laser', MARKERS)
    assert len(found) == bool(words)
    assert all(word in found[0] for word in words)


def test_check_without_its_prior_is_that_of_the_pictures():
    data, prior = ScaleCheck(ratio=1.004, u=3e-4), 5e-4
    weights = np.array([data.u**-2, prior**-2])
    mixed = ScaleCheck(ratio=weights @ [data.ratio, 1.0] / weights.sum(), u=weights.sum() ** -0.5)
    found = mixed.without_prior(prior)
    assert found.ratio == pytest.approx(data.ratio)
    assert found.u == pytest.approx(data.u)
    assert ScaleCheck(ratio=1.0, u=prior).without_prior(prior) is None


def test_hidden_markers_and_outliers_are_tolerated(cell):
    views = marker_views(cell, ANGLES, hidden={(2, 0), (2, 1), (5, 3), (9, 2)})
    uv = views.observations.uv.copy()
    uv[10:13] += 20.0
    result = calibrated(cell, replace(views, observations=replace(views.observations, uv=uv)))
    assert not result.inlier_mask[10:13].any()
    assert np.linalg.norm(moved(cell, result)[:3, 3]) < 0.2e-3


def test_angles_of_a_scan_are_measured(cell):
    angles = np.linspace(0.0, 1.9, 12)
    views = marker_views(cell, angles)
    measured = measure_angles(cell.camera, cell.turntable, views)
    np.testing.assert_allclose(measured.axis.angles, angles, atol=2e-3)


def test_pictures_without_markers_are_interpolated_only_on_request(cell):
    angles = np.array([0.0, 0.1, 0.3, 0.4, 0.5, 0.6])
    views = marker_views(cell, angles)
    order = ['0.png', '1.png', 'dark.png', *(f'{k}.png' for k in range(2, 6)), 'end.png']
    measured = collect_angles(views, measure_angles(cell.camera, cell.turntable, views), order)
    assert measured.missing == ('dark.png', 'end.png')
    filled = fill_gaps(measured, order)
    assert filled.filled == ('dark.png',)
    assert filled.by_name['dark.png'] == pytest.approx(0.2, abs=3e-3)
    assert filled.missing == ('end.png',)


def test_too_few_pictures_are_refused(cell):
    with pytest.raises(CalibrationError, match=r'here: 4 pictures show DICT_4X4_50:20mm'):
        estimate_axis(cell.camera, marker_views(cell, ANGLES[:4]), 'here')


def test_a_table_that_hardly_turned_is_refused(cell):
    with pytest.raises(CalibrationError, match='here: the table turned by'):
        estimate_axis(cell.camera, marker_views(cell, np.linspace(0, 0.3, 8)), 'here')


def test_pictures_without_common_markers_are_refused(cell):
    hidden = {(p, g) for p in range(16) for g in range(4) if (g < 2) != (p < 8)}
    with pytest.raises(CalibrationError, match='no marker in common'):
        estimate_axis(cell.camera, marker_views(cell, ANGLES, hidden=hidden), 'here')


def test_volume_outside_the_calibrated_depth_gives_a_warning(cell):
    laser = replace(cell.lasers[0], volume=np.array([[-1, -1, 0.6], [1, 1, 1.2]]))
    assert 'calibrated 0.60 to 1.20 m' in depth_warning(laser, cell.turntable)[0]
    assert depth_warning(cell.lasers[0], cell.turntable) == []


@pytest.fixture(scope='module')
def charuco_pictures(tmp_path_factory, cell):
    board = parse_board('charuco:8x6:15mm:11mm:DICT_4X4_50')
    folder = tmp_path_factory.mktemp('platter')
    for k in range(8):
        image = render_platter_board(cell, board, 2 * np.pi * k / 8, rng=np.random.default_rng(k))
        cv2.imwrite(str(folder / f'{k}.png'), image)
    return board, [folder / f'{k}.png' for k in range(8)]


def test_charuco_board_gives_the_axis(cell, charuco_pictures):
    board, pictures = charuco_pictures
    result = calibrated(cell, detect_targets(cell.camera, board, pictures))
    error = moved(cell, result)
    assert np.linalg.norm(error[:2, 3]) < 0.05e-3
    assert np.linalg.norm(error[:3, 3]) < 0.1e-3
    assert result.scale_source == 'board'
    np.testing.assert_allclose(np.diff(list(result.angles.values())), np.pi / 4, atol=1e-3)


def test_markers_that_are_not_detected_are_named(cell, charuco_pictures):
    with pytest.raises(CalibrationError, match=r'none of 8 pictures shows DICT_6X6_50:30mm'):
        detect_targets(cell.camera, parse_markers('DICT_6X6_50:30mm'), charuco_pictures[1])


def test_picture_of_another_size_is_named(tmp_path, cell):
    cv2.imwrite(str(tmp_path / 'small.png'), np.zeros((10, 10), np.uint8))
    with pytest.raises(FileError, match=r'small\.png'):
        detect_targets(cell.camera, MARKERS, [tmp_path / 'small.png'])
