# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Areas of a triangle mesh, and points that are spread over it by area."""

import numpy as np

from ivfmc_ros.meshing.geometry.normals import area_vectors
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints


def face_areas(vertices_xyz: Floats, faces: Ints) -> Floats:
    """Return the area of triangles, (m,) square meters."""
    return np.asarray(0.5 * np.linalg.norm(area_vectors(vertices_xyz, faces), axis=1))


def vertex_areas(vertices_xyz: Floats, faces: Ints) -> Floats:
    """Return a third of the area of the faces around each vertex, (n,) square meters."""
    third = face_areas(vertices_xyz, faces) / 3.0
    return np.asarray(np.bincount(faces.ravel(), np.repeat(third, 3), len(vertices_xyz)))


def points_by_area(vertices_xyz: Floats, faces: Ints, count: int) -> tuple[Floats, Ints]:
    """
    Return points at random places of a mesh with an area; the same places for the same mesh.

    returns : (count, 3) meters, and the index of the face of each, (count,)
    """
    rng = np.random.default_rng(0)
    area = face_areas(vertices_xyz, faces)
    face = rng.choice(len(faces), count, p=area / area.sum())
    weights = rng.dirichlet(np.ones(3), count)
    return np.einsum('nk,nkc->nc', weights, vertices_xyz[faces[face]]), face
