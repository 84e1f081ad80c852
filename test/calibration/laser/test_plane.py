# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.calibration.laser.plane import find_inliers
from ivfmc_ros.calibration.laser.plane import fit_plane
from ivfmc_ros.calibration.laser.plane import least_median_plane
from ivfmc_ros.calibration.laser.plane import StripePoints
from ivfmc_ros.calibration.laser.plane import total_least_squares

NORMAL = np.array([0.8, 0.0, 0.6])
OFFSET = -0.25


def stripes(rng, count=20, pixel=1e-5, pose=2e-5, bow=0.0):
    """Lines on the plane at several depths, each moved along the normal by its pose's error."""
    views = []
    side = np.cross(NORMAL, [0.0, 1.0, 0.0])
    for _ in range(count):
        s = rng.uniform(-0.1, 0.1)
        t = np.linspace(-0.06, 0.06, 80)
        line = -OFFSET * NORMAL + (s + 0.3 * t)[:, None] * side + t[:, None] * [0.0, 1.0, 0.0]
        line += (bow * (s + 0.3 * t) ** 2)[:, None] * NORMAL
        line += (pixel * rng.standard_normal(80) + pose * rng.standard_normal())[:, None] * NORMAL
        pose_jacobian = np.zeros((80, 3, 1))
        pose_jacobian[:, :, 0] = NORMAL
        views.append(
            StripePoints(
                points_xyz=line,
                pixel_jacobian=np.tile(NORMAL * pixel, (80, 1)),
                pose_jacobian=pose_jacobian,
                sigma=1.0,
                pose_covariance=np.array([[pose**2]]),
            )
        )
    return views


def test_total_least_squares_finds_a_plane():
    points = np.concatenate([v.points_xyz for v in stripes(np.random.default_rng(0), pose=0.0)])
    plane = total_least_squares(points)
    np.testing.assert_allclose(plane, [*NORMAL, OFFSET], atol=1e-4)


def test_views_off_the_plane_are_outliers():
    rng = np.random.default_rng(0)
    views = stripes(rng)
    for k in range(6):
        wrong = views[k].points_xyz + np.array([0.0, 0.0, 0.01 * (k + 1)])
        views[k] = StripePoints(**{**views[k].__dict__, 'points_xyz': wrong})
    keep, plane = find_inliers(views, least_median_plane(views))
    assert [bool(k.any()) for k in keep] == [False] * 6 + [True] * 14
    np.testing.assert_allclose(plane, [*NORMAL, OFFSET], atol=1e-3)


def test_stated_covariance_matches_the_errors():
    ratios = []
    for seed in range(40):
        fit = fit_plane(stripes(np.random.default_rng(seed)), np.array([*NORMAL, OFFSET]))
        place = np.array([*(-OFFSET * NORMAL), 1.0])
        error = place @ [*fit.normal, fit.offset]
        ratios.append(error / np.sqrt(place @ fit.covariance @ place))
    assert 0.7 < np.std(ratios) < 1.5


def test_bow_is_measured():
    views = stripes(np.random.default_rng(0), pose=0.0, bow=0.05)
    fit = fit_plane(views, np.array([*NORMAL, OFFSET]), bowed=True)
    points = np.concatenate([view.points_xyz for view in views])
    assert np.sqrt(np.mean(fit.distance(points) ** 2)) < 2e-5
    flat = fit_plane(views, np.array([*NORMAL, OFFSET]))
    assert np.sqrt(np.mean(flat.distance(points) ** 2)) > 1e-4


def test_plane_has_unit_normal():
    fit = fit_plane(stripes(np.random.default_rng(1)), np.array([*NORMAL, OFFSET]))
    assert np.linalg.norm(fit.normal) == pytest.approx(1.0)
