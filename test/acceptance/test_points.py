# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np

from ivfmc_ros.acceptance.points import measured_points
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
    points, found = measured_points(mesh)
    np.testing.assert_array_equal(points, vertices[:2])
    assert found.shape == (2, 3)
