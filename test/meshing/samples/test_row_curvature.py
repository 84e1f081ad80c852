# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.meshing.samples.row_curvature import row_curvature

ROWS = 40
NOISE = 25e-6  # meters, of a point
SPACINGS = [0.05e-3, 0.3e-3, 0.9e-3]  # meters, between columns
THICKNESS = 1e-3 / 3  # of the sheet: windows of 1 mm to each side
HALF_LENGTH = 1e-3


def grid(plane_curve, spacing, half_width):
    """Return points and normals of a curve in x and y, upright; and connections."""
    at = np.arange(-half_width, half_width + 0.5 * spacing, spacing)
    xy, normal = plane_curve(at)
    rows = np.linspace(0.0, 0.01, ROWS)[:, None]
    points = np.stack(
        np.broadcast_arrays(xy[0][None], xy[1][None], rows + 0 * at[None]), axis=2
    ).copy()
    normals = np.broadcast_to(np.stack([*normal, 0 * at], axis=1), points.shape).copy()
    right, down = np.ones(points.shape[:2], dtype=bool), np.ones(points.shape[:2], dtype=bool)
    right[:, -1] = False
    down[-1] = False
    return points, normals, right, down


def circle(radius):
    def curve(at):
        angle = at / radius
        return (radius * np.cos(angle), radius * np.sin(angle)), (np.cos(angle), np.sin(angle))

    return curve


def corner(at):
    """Return two planes at a right angle, that meet at 0."""
    size = np.sqrt(0.5)
    return (-size * np.abs(at), size * at), (size + 0 * at, np.copysign(size, at))


def noisy(points, normals, seed=1):
    rng = np.random.default_rng(seed)
    tilt = 0.05 * rng.standard_normal(points.shape[:2])
    along = np.stack([-normals[..., 1], normals[..., 0], normals[..., 2]], axis=2)
    turned = normals + tilt[..., None] * along
    turned /= np.linalg.norm(turned, axis=2, keepdims=True)
    return points + NOISE * rng.standard_normal(points.shape[:2])[..., None] * normals, turned


@pytest.mark.parametrize('spacing', SPACINGS)
@pytest.mark.parametrize('hollow', [False, True])
def test_curvature_of_a_noisy_cylinder_at_any_spacing(spacing, hollow):
    radius = 0.008
    points, normals, right, down = grid(circle(radius), spacing, 0.004)
    if hollow:
        normals = -normals
    found = row_curvature(*noisy(points, normals), right, down, THICKNESS)
    assert found.known.all()
    expected = -1.0 / radius if hollow else 1.0 / radius
    assert found.value.mean() == pytest.approx(expected, rel=0.1)
    # at the ends, too
    assert found.value[:, :2].mean() == pytest.approx(expected, rel=0.25)
    assert found.value.std() < 0.25 / radius


@pytest.mark.parametrize('spacing', SPACINGS)
def test_edge_is_not_taken_for_curvature(spacing):
    points, normals, right, down = grid(corner, spacing, 0.006)
    found = row_curvature(*noisy(points, normals), right, down, THICKNESS)
    # to 1 sigma no more than the noise of flat rows
    away = found.value[:, np.abs(points[0, :, 1]) > 2e-3]
    assert np.sqrt((away**2).mean()) < 30.0
    assert abs(away.mean()) < 10.0
    # a right angle has more than 0.9 of it over a half length
    assert np.abs(found.value).max() < 0.5 / (spacing * max(2, np.floor(HALF_LENGTH / spacing)))


def test_rows_of_another_surface_do_not_count():
    """A cylinder stands on a plate, which is flat along the rows."""
    radius = 0.008
    points, normals, right, down = grid(circle(radius), 0.3e-3, 0.004)
    flat = points[0, :, 1]
    points[20:] = np.stack([flat * 0 + radius, flat, flat * 0 + 0.006], axis=1)
    points[20:, :, 0] += 0.3e-3 * np.arange(20)[:, None]
    normals[20:] = [0.0, 0.0, 1.0]
    found = row_curvature(points, normals, right, down, THICKNESS)
    assert found.value[19, 13] == pytest.approx(1.0 / radius, rel=0.02)
    assert found.value[20, 13] == pytest.approx(0.0, abs=1.0)


def test_turn_that_closes_has_no_ends():
    radius, count = 0.008, 120
    angle = 2 * np.pi * np.arange(count) / count
    normal = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    points = radius * normal + np.linspace(0, 0.01, ROWS)[:, None, None] * [0, 0, 1]
    normals = np.broadcast_to(normal, points.shape)
    yes = np.ones(points.shape[:2], dtype=bool)
    down = yes.copy()
    down[-1] = False
    found = row_curvature(points, normals, yes, down, THICKNESS)
    assert found.known.all()
    np.testing.assert_allclose(found.value, 1.0 / radius, rtol=0.02)


def test_curvature_of_few_rows_is_unknown():
    points, normals, right, down = grid(circle(0.008), 0.3e-3, 0.004)
    found = row_curvature(points[:4], normals[:4], right[:4], down[:4], THICKNESS)
    assert not found.known.any()
    assert (found.value == 0.0).all()
    assert found.local[2, 10] == pytest.approx(125.0, rel=0.05)


def test_missing_points_break_the_rows():
    points, normals, right, down = grid(circle(0.008), 0.3e-3, 0.004)
    points[:, 12], normals[:, 12] = np.nan, np.nan
    right[:, 11:13] = False
    found = row_curvature(points, normals, right, down, THICKNESS)
    assert np.isfinite(found.value).all()
    np.testing.assert_allclose(found.value[:, :12], 125.0, rtol=0.02)
    assert not found.known[:, 12].any()
