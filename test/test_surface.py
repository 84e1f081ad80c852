# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
import trimesh

from ivfmc_ros.surface import Surface


def box():
    """A box of 20, 30, 40 mm about the origin."""
    solid = trimesh.creation.box(extents=(0.02, 0.03, 0.04))
    return Surface(
        np.asarray(solid.vertices, dtype=np.float64), np.asarray(solid.faces, dtype=np.int64)
    )


def test_nearest_point_is_found_with_the_normal_of_its_face():
    points = np.array([[0.02, 0.003, 0.004], [0.001, -0.002, 0.018], [0.0, -0.05, 0.0]])
    found = box().nearest(points)
    expected = [[0.01, 0.003, 0.004], [0.001, -0.002, 0.02], [0.0, -0.015, 0.0]]
    assert found.points_xyz == pytest.approx(np.array(expected), abs=1e-8)
    assert found.distance == pytest.approx([0.01, 0.002, 0.035], abs=1e-8)
    assert found.normals == pytest.approx(np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]))


def test_distance_to_a_corner_is_euclidean():
    found = box().nearest(np.array([[0.013, 0.019, 0.032]]))
    assert found.distance[0] == pytest.approx(0.013, abs=1e-8)


def test_signed_distance_is_negative_inside():
    points = np.array([[0.0, 0.0, 0.0], [0.012, 0.0, 0.0], [0.009, 0.0, 0.0]])
    assert box().signed_distance(points) == pytest.approx([-0.01, 0.002, -0.001], abs=1e-8)


def test_rays_hit_the_first_face():
    origins = np.array([[0.1, 0.0, 0.0], [0.0, 0.001, 0.1], [0.1, 0.1, 0.0]])
    directions = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, -2.0], [-1.0, 0.0, 0.0]])
    hits = box().cast(origins, directions)
    # in lengths of the direction, which is 2 for the second
    assert hits.distance == pytest.approx([0.09, 0.04, np.inf], abs=1e-7)
    assert hits.normals[:2] == pytest.approx(np.array([[1.0, 0, 0], [0, 0, 1]]))


def test_one_direction_is_broadcast_to_all_rays():
    origins = np.array([[0.1, 0.0, 0.0], [0.1, 0.01, 0.01]])
    hits = box().cast(origins, np.array([-1.0, 0.0, 0.0]))
    assert hits.distance == pytest.approx([0.09, 0.09], abs=1e-7)


def test_ray_from_inside_hits_a_face_from_behind():
    hits = box().cast(np.zeros((1, 3)), np.array([[0.0, 1.0, 0.0]]))
    assert hits.distance[0] == pytest.approx(0.015, abs=1e-8)
    assert hits.normals[0] == pytest.approx([0, 1, 0])


def test_empty_queries_give_empty_results():
    none = np.empty((0, 3))
    assert box().nearest(none).distance.shape == (0,)
    assert box().cast(none, none).distance.shape == (0,)
