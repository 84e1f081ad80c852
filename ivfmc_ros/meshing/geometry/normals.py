# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Unit normals of triangles and of vertices."""

import numpy as np

from ivfmc_ros.meshing.geometry import topology
from ivfmc_ros.meshing.parallel import run_chunked
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints

_CHUNK = 1 << 14  # faces


def vertex_normals(vertices_xyz: Floats, faces: Ints) -> Floats:
    """
    Return the normal of every vertex: the area-weighted mean of the normals of its faces.

    vertices_xyz : (n, 3) float64, meters
    faces : (m, 3) int64, counter-clockwise seen from outside
    returns : (n, 3) float64, unit; NaN at a vertex that has no face with an area
    """
    # the cross product of two edges is twice the area long, which is the weight
    areas = np.empty((len(faces), 3))

    def compute(chunk: slice) -> None:
        areas[chunk] = area_vectors(vertices_xyz, faces[chunk])

    run_chunked(compute, len(faces), _CHUNK)
    total = topology.face_to_vertex_sum(faces, len(vertices_xyz)) @ areas
    with np.errstate(invalid='ignore'):
        total /= np.sqrt(np.einsum('nc,nc->n', total, total))[:, None]
    return np.asarray(total)


def face_normals(vertices_xyz: Floats, faces: Ints) -> Floats:
    """
    Return the normals of triangles.

    vertices_xyz : (n, 3) float64
    faces : (m, 3) int64, counter-clockwise seen from outside
    returns : (m, 3) float64, unit; NaN for a triangle without area
    """
    areas = area_vectors(vertices_xyz, faces)
    with np.errstate(invalid='ignore'):
        return np.asarray(areas / np.linalg.norm(areas, axis=1, keepdims=True))


def area_vectors(vertices_xyz: Floats, faces: Ints) -> Floats:
    """Return (m, 3) cross products of two edges of triangles: the normal times twice the area."""
    a, b, c = (vertices_xyz.take(column, axis=0).T for column in faces.T)
    return np.ascontiguousarray(cross(b - a, c - a).T)


def cross(first: Floats, second: Floats) -> Floats:
    """Return the (3, n) cross products of two (3, n) arrays of column vectors."""
    (ax, ay, az), (bx, by, bz) = first, second
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
