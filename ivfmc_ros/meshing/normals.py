# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Normals of triangles and vertices."""

import numpy as np

from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints


def of_vertices(vertices_xyz: Floats, faces: Ints) -> Floats:
    """
    Return the normal of every vertex: the mean of its faces' normals, weighted by their area.

    vertices_xyz : (n, 3) metres; faces : (m, 3)
    returns : (n, 3) float64, unit; NaN at a vertex without a face of some area
    """
    # the cross product is twice the area long, which is the weight
    across = np.cross(
        vertices_xyz[faces[:, 1]] - vertices_xyz[faces[:, 0]],
        vertices_xyz[faces[:, 2]] - vertices_xyz[faces[:, 0]],
    )
    count = len(vertices_xyz)
    corner = faces.ravel()
    total = np.stack(
        [np.bincount(corner, np.repeat(across[:, k], 3), minlength=count) for k in range(3)],
        axis=1,
    )
    with np.errstate(invalid='ignore'):
        return np.asarray(total / np.linalg.norm(total, axis=1, keepdims=True))


def of_faces(vertices_xyz: Floats, faces: Ints) -> Floats:
    """Return (m, 3) unit normals of faces; NaN for one without area."""
    corners = vertices_xyz[faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    with np.errstate(invalid='ignore'):
        return np.asarray(across / np.linalg.norm(across, axis=1, keepdims=True))
