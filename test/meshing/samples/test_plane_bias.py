# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

from ivfmc_ros.meshing.samples.plane_bias import height_over_planes
from ivfmc_ros.meshing.samples.planes import fit_planes
from ivfmc_ros.meshing.samples.planes import Neighborhood
from ivfmc_ros.meshing.samples.range_grid import RangeGrid

RADIUS, STEP, THICKNESS = 0.011, 3e-4, 3e-4
TOLERANCE = 1e-3  # meters, so that all neighbors are inliers
PLACE = (np.array([15, 10]), np.array([12, 18]))


def grid(heights, thickness=THICKNESS):
    """Return rows along y and columns along x, seen from above."""
    at = STEP * np.arange(-15.0, 16.0)
    y, x = np.meshgrid(at, at, indexing='ij')
    points = np.stack([x, y, heights(x, y)], axis=2)
    return RangeGrid(
        points_xyz=points,
        to_camera=np.array([0.0, 0.0, 1.0]),
        sigma=np.full(x.shape, 2e-5),
        intensity=np.full(x.shape, 100.0),
        thickness=thickness,
    )


def planes_of(one):
    points = one.points_xyz
    neighborhood = Neighborhood(
        points_xyz=points.reshape(-1, 3), max_neighbors=25, radius=2e-3, distance_sigma=1e-3
    )
    return fit_planes(points[PLACE], neighborhood, TOLERANCE, STEP, through_query=False)


def missed(one):
    """Return the heights of the query points over their planes, toward the camera."""
    planes = planes_of(one)
    return planes, planes.height * np.copysign(1.0, planes.normals[:, 2])


def sphere(x, y):
    return np.sqrt(RADIUS**2 - x**2 - y**2)


def lying_cylinder(x, y):
    return np.sqrt(RADIUS**2 - y**2) + 0.0 * x


@pytest.mark.parametrize('heights', [sphere, lying_cylinder, lambda x, y: -sphere(x, y)])
def test_height_of_curved_surfaces_over_their_planes(heights):
    one = grid(heights)
    planes, expected = missed(one)
    assert np.abs(expected).min() > 4e-6
    found = height_over_planes(one, None, PLACE, planes)
    np.testing.assert_allclose(found, expected, rtol=0.15)


def test_plane_has_no_height_over_itself():
    one = grid(lambda x, y: 0.2 * x + 0.1 * y)
    planes, _ = missed(one)
    np.testing.assert_allclose(height_over_planes(one, None, PLACE, planes), 0.0, atol=1e-9)


def test_nothing_is_known_without_a_thickness_or_without_neighbors():
    bare = grid(sphere, thickness=0.0)
    assert (height_over_planes(bare, None, PLACE, planes_of(bare)) == 0.0).all()
    one = grid(sphere)
    planes = planes_of(one)
    holes = one.points_xyz.copy()
    holes[:, ::2], holes[::2] = np.nan, np.nan
    empty = replace(one, points_xyz=holes)
    assert (height_over_planes(empty, None, PLACE, planes) == 0.0).all()
