# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.acceptance.points import measured_points
from ivfmc_ros.acceptance.points import points_of_file
from ivfmc_ros.inspection.mesh_file import MeshBody
from ivfmc_ros.model import FILLED
from ivfmc_ros.model import MEASURED
from ivfmc_ros.model import Mesh


def test_vertices_of_filled_holes_are_left_out():
    vertices = np.arange(18.0).reshape(6, 3)
    normals = np.tile([0.0, 0.0, 1.0], (6, 1))
    normals[5] = np.nan  # no face uses it
    mesh = Mesh(
        vertices_xyz=vertices,
        faces=np.array([[0, 1, 2], [2, 3, 4]]),
        normals=normals,
        sigma=np.zeros(6),
        intensity=np.zeros(6),
        kind=np.array([MEASURED, FILLED], dtype=np.uint8),
    )
    found = measured_points(mesh, 1e-6)
    np.testing.assert_array_equal(found.points_xyz, vertices[:2])
    assert found.normals.shape == (2, 3)
    assert found.left_out == 0.0


@pytest.mark.parametrize('systematic', [[0.0, 4e-5, 0.0, np.nan], None])
def test_vertices_of_a_large_uncertainty_are_left_out(systematic):
    sigma = np.array([2e-5, 1e-5, 4e-5, 1e-5])
    shared = None if systematic is None else np.array(systematic)
    vertices = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    mesh = Mesh(
        vertices_xyz=vertices,
        faces=faces,
        normals=np.tile([0.0, 0.0, 1.0], (4, 1)),
        sigma=sigma,
        systematic=shared,
        intensity=np.zeros(4),
    )
    body = MeshBody(
        vertices_xyz=vertices, faces=faces, closed=False, sigma=sigma, systematic=shared
    )
    kept = [0, 3] if systematic else [0, 1, 3]
    for found in (measured_points(mesh, 6e-5), points_of_file(body, 6e-5)):
        np.testing.assert_array_equal(found.points_xyz, vertices[kept])
        assert found.left_out == 1.0 - len(kept) / 4
        assert (found.systematic is None) == (systematic is None)


def test_file_that_states_no_uncertainty_keeps_its_vertices():
    vertices = np.eye(3)
    body = MeshBody(vertices_xyz=vertices, faces=np.array([[0, 1, 2]]), closed=False)
    found = points_of_file(body, 1e-9)
    assert len(found.points_xyz) == 3
    assert found.systematic is None
