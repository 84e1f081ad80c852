# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

from ivfmc_ros.meshing.samples.planes import fit_planes
from ivfmc_ros.meshing.samples.planes import Neighborhood

VOXEL = 2e-4
SIGMA = 2e-5
UP = np.array([0.0, 0.0, 1.0])
ACROSS = np.array([1.0, 0.0, 0.0])


@pytest.fixture
def corner():
    """Return a floor z = 0 at x < 0 with many points, and a wall x = 0 above it with few."""
    rng = np.random.default_rng(2)
    floor = np.column_stack([rng.uniform(-3e-3, 0, 900), rng.uniform(-3e-3, 3e-3, 900)])
    floor = np.column_stack([floor, rng.normal(scale=SIGMA, size=900)])
    wall = np.column_stack([rng.uniform(-3e-3, 3e-3, 200), rng.uniform(0, 3e-3, 200)])
    wall = np.column_stack([rng.normal(scale=SIGMA, size=200), wall])
    normals = np.concatenate([np.tile(UP, (900, 1)), np.tile(-ACROSS, (200, 1))])
    return Neighborhood(
        points_xyz=np.concatenate([floor, wall]),
        normals=normals,
        max_neighbors=25,
        radius=6 * VOXEL,
        distance_sigma=2 * VOXEL,
    )


def test_plane_of_most_is_found_beside_points_of_another_face(corner):
    queries = np.array([[-3e-4, 0.0, 2e-4], [-3e-4, 1e-3, -3e-4]])
    planes = fit_planes(queries, corner, 2 * SIGMA, VOXEL, through_query=False)
    assert np.abs(planes.normals @ UP) == pytest.approx([1.0, 1.0], abs=5e-3)
    height = planes.height * np.sign(planes.normals @ UP)
    assert height == pytest.approx([2e-4, -3e-4], abs=2 * SIGMA)
    assert (planes.inlier_ratio > 0.6).all()
    assert (planes.inliers > 8).all()
    assert (planes.breadth > 0.7 * VOXEL).all()
    assert (planes.height_sigma < 1.2).all()


def test_plane_through_a_point_needs_inliers_with_its_normal(corner):
    queries = np.array([[0.0, 0.0, 1.5e-3]])
    planes = fit_planes(queries, corner, 2 * SIGMA, VOXEL, through_query=True)
    assert abs(planes.normals[0] @ ACROSS) == pytest.approx(1.0, abs=5e-3)
    assert planes.inlier_ratio[0] > 0.9
    turned = replace(corner, normals=np.tile([0.0, 1.0, 0.0], (1100, 1)))
    assert fit_planes(queries, turned, 2 * SIGMA, VOXEL, through_query=True).inlier_ratio[0] == 0.0


def test_no_plane_without_neighbors(corner):
    planes = fit_planes(np.array([[1.0, 1.0, 1.0]]), corner, 2 * SIGMA, VOXEL, through_query=False)
    assert planes.inlier_ratio[0] == 0.0
    assert planes.inliers[0] == 0.0


def test_no_queries_give_no_planes(corner):
    planes = fit_planes(np.empty((0, 3)), corner, 2 * SIGMA, VOXEL, through_query=False)
    assert planes.normals.shape == (0, 3)
