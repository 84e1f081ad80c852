# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Projection of uncertain points: a wall seen obliquely, with truncated stripe ends off it."""

from dataclasses import replace

import numpy as np
import pytest

from ivfmc_ros.meshing.samples.range_grid import RangeGrid
from ivfmc_ros.meshing.samples.ray_projection import ClassifiedGrid
from ivfmc_ros.meshing.samples.ray_projection import project_uncertain_points

SIGMA = 2e-5
STEP = 2e-4
VOXEL = 2e-4
TO_CAMERA = np.array([0.0, 1.0, 0.5]) / np.hypot(1.0, 0.5)
ERROR = np.array([0.6, 0.8, 0.0])
THICKNESS = 4e-4


@pytest.fixture
def wall():
    """Rows along z and columns along x on the plane y = 0, with noise."""
    rng = np.random.default_rng(0)
    row, column = np.meshgrid(np.arange(40.0), np.arange(12.0), indexing='ij')
    noise = rng.normal(scale=0.5 * SIGMA, size=row.shape)
    points = np.stack([2 * STEP * column, noise, STEP * row], axis=2)
    return RangeGrid(
        points_xyz=points,
        to_camera=np.broadcast_to(TO_CAMERA, points.shape),
        error_direction=np.broadcast_to(ERROR, points.shape),
        sigma=np.full(row.shape, SIGMA),
        intensity=np.full(row.shape, 100.0),
        thickness=THICKNESS,
    )


def displace(grid, row, columns, way):
    points = grid.points_xyz.copy()
    points[row, columns] += np.asarray(way)[:, None] * ERROR
    return replace(grid, points_xyz=points)


def ray_distances(grid, row, columns):
    """Return a function for the distances (meters) of points from the rays of a grid."""

    def miss(other):
        step = other.points_xyz[row, columns] - grid.points_xyz[row, columns]
        return np.linalg.norm(np.cross(step, TO_CAMERA), axis=1)

    return miss


def project(grid):
    (found,), dropped = project_uncertain_points(
        [ClassifiedGrid.of(grid, None, SIGMA)], SIGMA, VOXEL
    )
    return found, dropped


def test_truncated_ends_move_along_their_rays_onto_the_surface(wall):
    columns = np.array([3, 4, 8])
    displaced = displace(wall, 39, columns, [3e-4, 4e-4, -2.5e-4])
    found, dropped = project(displaced)
    moved = found.points_xyz[39, columns]
    assert np.abs(moved[:, 1]).max() < 2 * SIGMA
    assert ray_distances(displaced, 39, columns)(found).max() < 1e-9
    assert len(dropped) == 0
    assert (found.sigma[39, columns] < 2 * SIGMA).all()


def test_ends_outside_the_light_sheet_are_dropped(wall):
    displaced = displace(wall, 39, np.array([5]), [3e-3])
    found, _ = project(displaced)
    assert np.isnan(found.points_xyz[39, 5]).all()


def test_point_of_large_sigma_moves_within_its_uncertainty(wall):
    sigma = wall.sigma.copy()
    sigma[5:30, 0] = 8 * SIGMA
    displaced = displace(replace(wall, sigma=sigma), 20, np.array([0]), [6 * SIGMA])
    found, _ = project(displaced)
    assert abs(found.points_xyz[20, 0, 1]) < 1.5 * SIGMA
    assert found.sigma[20, 0] < 2 * SIGMA
    # a point of small sigma keeps its place
    sure = displace(wall, 20, np.array([6]), [6 * SIGMA])
    assert np.array_equal(project(sure)[0].points_xyz[20, 6], sure.points_xyz[20, 6])


def test_far_end_between_two_faces_is_dropped_or_on_one(wall):
    """Half of the points around are on another face: the ray meets both."""
    points = wall.points_xyz.copy()
    points[30:, :, 1] -= 0.9 * (points[30:, :, 2] - points[30, :, 2])
    points[39, 6] += 4e-4 * ERROR
    found, _ = project(replace(wall, points_xyz=points))
    at = found.points_xyz[39, 6]
    on_slope = np.abs(at[1] + 0.9 * (at[2] - 30 * STEP))
    assert np.isnan(at).all() or on_slope < 4 * SIGMA


def test_without_points_nothing_happens(wall):
    none = replace(wall, points_xyz=np.full_like(wall.points_xyz, np.nan))
    found, dropped = project(none)
    assert np.isnan(found.points_xyz).all()
    assert len(dropped) == 0


def test_point_of_large_sigma_moves_onto_a_curved_surface():
    """The plane through its neighbors lies 0.02 mm inside."""
    radius = 0.008
    rng = np.random.default_rng(0)
    row, column = np.meshgrid(np.arange(40.0), np.arange(-20.0, 21.0), indexing='ij')
    angle = np.pi / 2 + 1.5 * STEP * column / radius
    normal = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=2)
    noise = rng.normal(scale=0.2 * SIGMA, size=row.shape)
    points = (radius + noise)[..., None] * normal
    points[..., 2] = 1.5 * STEP * row
    sigma = np.full(row.shape, SIGMA)
    uncertain = (np.arange(8, 32, 4)[:, None], np.arange(10, 31, 4))
    sigma[uncertain] = 6 * SIGMA
    grid = RangeGrid(
        points_xyz=points,
        to_camera=np.broadcast_to(TO_CAMERA, points.shape),
        error_direction=np.broadcast_to(ERROR, points.shape),
        sigma=sigma,
        intensity=np.full(row.shape, 100.0),
        thickness=THICKNESS,
    )
    found, _ = project(grid)
    moved = found.points_xyz[uncertain]
    assert (found.sigma[uncertain] < 2 * SIGMA).all()
    assert abs((np.hypot(moved[..., 0], moved[..., 1]) - radius).mean()) < 0.1 * SIGMA
