# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Normals of triangles and vertices."""

import numpy as np

from ivfmc_ros.meshing.geometry import topology
from ivfmc_ros.meshing.parallel import in_parts
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints

_AT_ONCE = 1 << 14  # faces


def of_vertices(vertices_xyz: Floats, faces: Ints) -> Floats:
    """
    Return the normal of every vertex: the mean of its faces' normals, weighted by their area.

    vertices_xyz : (n, 3) metres; faces : (m, 3)
    returns : (n, 3) float64, unit; NaN at a vertex without a face of some area
    """
    # the cross product is twice the area long, which is the weight
    across = np.empty((len(faces), 3))

    def compute(some: slice) -> None:
        across[some] = _across(vertices_xyz, faces[some])

    in_parts(compute, len(faces), _AT_ONCE)
    total = topology.adding(faces, len(vertices_xyz)) @ across
    with np.errstate(invalid='ignore'):
        total /= np.sqrt(np.einsum('nc,nc->n', total, total))[:, None]
    return np.asarray(total)


def of_faces(vertices_xyz: Floats, faces: Ints) -> Floats:
    """Return (m, 3) unit normals of faces; NaN for one without area."""
    across = _across(vertices_xyz, faces)
    with np.errstate(invalid='ignore'):
        return np.asarray(across / np.linalg.norm(across, axis=1, keepdims=True))


def _across(vertices_xyz: Floats, faces: Ints) -> Floats:
    a, b, c = (vertices_xyz.take(column, axis=0).T for column in faces.T)
    return np.ascontiguousarray(cross(b - a, c - a).T)


def cross(first: Floats, second: Floats) -> Floats:
    """Return the (3, n) cross products of (3, n) vectors."""
    (ax, ay, az), (bx, by, bz) = first, second
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
