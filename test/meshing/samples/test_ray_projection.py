# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A wall that is seen obliquely, with points that a cut stripe put before it."""

from dataclasses import replace

import numpy as np
import pytest

from ivfmc_ros.meshing.samples.ray_projection import settled
from ivfmc_ros.meshing.samples.ray_projection import Stripes
from ivfmc_ros.meshing.samples.surface_samples import RangeGrid

SIGMA = 2e-5
STEP = 2e-4
VOXEL = 2e-4
SIGHT = np.array([0.0, 1.0, 0.5]) / np.hypot(1.0, 0.5)
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
        sight=np.broadcast_to(SIGHT, points.shape),
        error=np.broadcast_to(ERROR, points.shape),
        sigma=np.full(row.shape, SIGMA),
        intensity=np.full(row.shape, 100.0),
        thickness=THICKNESS,
    )


def off(grid, row, columns, way):
    points = grid.points_xyz.copy()
    points[row, columns] += np.asarray(way)[:, None] * ERROR
    return replace(grid, points_xyz=points)


def rays_through(grid, row, columns):
    """How far the points of a settled grid are from the rays of the given one."""

    def miss(other):
        step = other.points_xyz[row, columns] - grid.points_xyz[row, columns]
        return np.linalg.norm(np.cross(step, SIGHT), axis=1)

    return miss


def settle(grid):
    (found,), left_out = settled([Stripes.of(grid, None, SIGMA)], SIGMA, VOXEL)
    return found, left_out


def test_cut_ends_go_along_their_rays_onto_the_surface(wall):
    columns = np.array([3, 4, 8])
    spoilt = off(wall, 39, columns, [3e-4, 4e-4, -2.5e-4])
    found, left_out = settle(spoilt)
    moved = found.points_xyz[39, columns]
    assert np.abs(moved[:, 1]).max() < 2 * SIGMA
    assert rays_through(spoilt, 39, columns)(found).max() < 1e-9
    assert len(left_out) == 0
    assert (found.sigma[39, columns] < 2 * SIGMA).all()


def test_farther_than_the_light_is_thick_they_are_left_out(wall):
    spoilt = off(wall, 39, np.array([5]), [3e-3])
    found, _ = settle(spoilt)
    assert np.isnan(found.points_xyz[39, 5]).all()


def test_point_of_large_sigma_goes_as_far_as_it_is_unsure(wall):
    sigma = wall.sigma.copy()
    sigma[5:30, 0] = 8 * SIGMA
    spoilt = off(replace(wall, sigma=sigma), 20, np.array([0]), [6 * SIGMA])
    found, _ = settle(spoilt)
    assert abs(found.points_xyz[20, 0, 1]) < 1.5 * SIGMA
    assert found.sigma[20, 0] < 2 * SIGMA
    # a point that is sure of its place stays there
    sure = off(wall, 20, np.array([6]), [6 * SIGMA])
    assert np.array_equal(settle(sure)[0].points_xyz[20, 6], sure.points_xyz[20, 6])


def test_end_far_off_that_some_points_contradict_stays_out(wall):
    """Half of the points around are on another face: the ray could mean either."""
    points = wall.points_xyz.copy()
    points[30:, :, 1] -= 0.9 * (points[30:, :, 2] - points[30, :, 2])
    points[39, 6] += 4e-4 * ERROR
    found, _ = settle(replace(wall, points_xyz=points))
    at = found.points_xyz[39, 6]
    on_slope = np.abs(at[1] + 0.9 * (at[2] - 30 * STEP))
    assert np.isnan(at).all() or on_slope < 4 * SIGMA


def test_without_points_nothing_happens(wall):
    none = replace(wall, points_xyz=np.full_like(wall.points_xyz, np.nan))
    found, left_out = settle(none)
    assert np.isnan(found.points_xyz).all()
    assert len(left_out) == 0
