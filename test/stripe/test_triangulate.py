# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from support.synthetic import small_camera
from support.synthetic import small_cell
from support.synthetic import Sphere

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.cell import Turntable
from ivfmc_ros.cell.laser import Bow
from ivfmc_ros.cell.laser import LaserPlane
from ivfmc_ros.model import Frame
from ivfmc_ros.stripe.extract import Stripe
from ivfmc_ros.stripe.triangulate import sensitivity
from ivfmc_ros.stripe.triangulate import triangulate

FOCAL, BASE = 1000.0, 0.2
MIDDLE = np.array([319.5, 255.5])


def plain_cell():
    """
    Return a textbook cell: all can be worked out on paper.

    The laser is BASE to the right and shines at 45 degrees to the left: X = BASE - Z, so that
    Z = BASE / (x + 1) for the ray (x, y, 1). The table's axis points up, 0.15 m ahead.
    """
    root = np.sqrt(0.5)
    K = np.array([[FOCAL, 0, MIDDLE[0]], [0, FOCAL, MIDDLE[1]], [0, 0, 1.0]])
    up = np.array([[0.0, 1, 0], [0, 0, -1], [-1, 0, 0]])
    return Cell(
        camera=small_camera(K=K),
        turntable=Turntable(camera_from_base=transforms.rigid(up, (0.0, 0.03, 0.15))),
        lasers=(LaserPlane(name='a', normal=np.array([root, 0, root]), offset=-BASE * root),),
    )


def frame_at(angle=0.0, laser=0):
    image = np.zeros((512, 640), dtype=np.uint8)
    return Frame(image=image, stamp_ns=17, angle=angle, laser=laser, view=3, seq=5)


def stripe_at(uv, sigma=0.1):
    uv = np.asarray(uv, dtype=np.float64).reshape(-1, 2)
    each = np.ones(len(uv))
    return Stripe(uv=uv, intensity=100 * each, width=2.5 * each, sigma=sigma * each)


def test_textbook_point_is_found():
    u, v = 419.5, 205.5  # the ray (0.1, -0.05, 1)
    depth = BASE / 1.1
    X, Y, Z = 0.1 * depth, -0.05 * depth, depth
    profile = triangulate(plain_cell(), frame_at(), stripe_at([[u, v]]))
    # base: x to the camera, y to the right of the picture, z up; origin at (0, 0.03, 0.15)
    assert profile.points_xyz[0] == pytest.approx([0.15 - Z, X, 0.03 - Y], abs=1e-15)


def test_profile_says_where_it_comes_from():
    profile = triangulate(plain_cell(), frame_at(0.5), stripe_at([[419.5, 205.5]]))
    assert (profile.angle, profile.laser, profile.view, profile.seq) == (0.5, 0, 3, 5)
    assert profile.stamp_ns == 17
    assert profile.uv.tolist() == [[419.5, 205.5]]
    assert profile.intensity.tolist() == [100.0]


@pytest.mark.parametrize('degrees', [0.0, 30.0, 90.0, -120.0, 400.0])
def test_point_seen_at_an_angle_is_at_minus_the_angle_in_the_part(degrees):
    cell, stripe = plain_cell(), stripe_at([[330.0, 200.0]])
    still = triangulate(cell, frame_at(0.0), stripe).points_xyz[0]
    turned = triangulate(cell, frame_at(np.radians(degrees)), stripe).points_xyz[0]
    azimuth = np.arctan2(turned[1], turned[0]) - np.arctan2(still[1], still[0])
    assert np.exp(1j * azimuth) == pytest.approx(np.exp(-1j * np.radians(degrees)))
    assert np.hypot(*turned[:2]) == pytest.approx(np.hypot(*still[:2]))
    assert turned[2] == pytest.approx(still[2])


def test_eccentric_sphere_is_round_over_a_turn():
    cell, sphere = small_cell(), Sphere(np.array([0.012, -0.007, 0.045]), 0.02)
    count = 0
    for angle in np.radians([0.0, 70.0, 140.0, 215.0, 300.0]):
        for laser in (0, 1):
            stripe = stripe_at(sphere.stripe(cell, angle, laser))
            points = triangulate(cell, frame_at(angle, laser), stripe).points_xyz
            count += len(points)
            assert np.abs(sphere.distance(points)).max() < 1e-12
    assert count > 500


def test_sigma_of_the_textbook_point_is_right():
    # X = B (x, y, 1) / (x + 1): dX/dx = B (1, -y, -1) / (x + 1)^2, dx = du / f
    x, y = 0.1, -0.05
    length = BASE / FOCAL * np.sqrt(2.0 + y * y) / (1 + x) ** 2
    stripe = stripe_at([[MIDDLE[0] + x * FOCAL, MIDDLE[1] + y * FOCAL]], sigma=0.2)
    profile = triangulate(plain_cell(), frame_at(), stripe)
    assert profile.sigma[0] == pytest.approx(0.2 * length, rel=1e-5)


def bowed(laser):
    along = np.cross(laser.normal, [0.0, 1.0, 0.0])
    ahead = np.array([0.0, 0.0, 0.4])
    bow = Bow(
        center=ahead - laser.distance(ahead[None])[0] * laser.normal,
        along=along / np.linalg.norm(along),
        coefficients=np.array([0.3, 0.1, -0.2]),
    )
    return replace(laser, bow=bow)


@pytest.mark.parametrize('direction', ['rows', 'columns'])
@pytest.mark.parametrize('bow', [False, True])
def test_sensitivity_is_the_derivative_of_the_geometry(direction, bow):
    camera = small_camera(distortion=np.array([-0.3, 0.1, 1e-3, -1e-3, 0.0]))
    cell = small_cell(camera)
    laser = replace(cell.lasers[0], stripe=direction)
    laser = bowed(laser) if bow else laser
    uv = np.random.default_rng(1).uniform([100, 100], [540, 412], (50, 2))
    step = 1e-3 * np.array([1.0, 0.0] if direction == 'rows' else [0.0, 1.0])
    ahead, behind = (laser.intersect(camera.rays(uv + s)) for s in (step, -step))
    expected = (ahead - behind) / 2e-3
    found = sensitivity(cell, laser, camera.rays(uv))
    assert np.isfinite(found).all()
    assert np.abs(found - expected).max() < 1e-4 * np.abs(expected).max()
    if not bow:
        # the error moves the point in the sheet, not along the ray
        assert np.abs(found @ laser.normal).max() < 1e-12


def test_pixel_whose_ray_misses_the_sheet_is_left_out():
    cell = plain_cell()
    K = cell.camera.K.copy()
    K[0, 0] = 100.0
    wide = replace(cell, camera=replace(cell.camera, K=K))
    # x = -1.5: the ray runs away from the sheet
    profile = triangulate(wide, frame_at(), stripe_at([[MIDDLE[0] - 150, 200.0], [330, 201]]))
    assert profile.uv.tolist() == [[330, 201]]
    assert np.isfinite(profile.points_xyz).all()


def test_no_stripe_no_points():
    profile = triangulate(plain_cell(), frame_at(), stripe_at(np.empty((0, 2))))
    assert len(profile) == 0
    assert profile.points_xyz.shape == (0, 3)
