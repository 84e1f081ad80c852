# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A nominal surface cut into its faces, as CAD would call them, and what shape each has."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ivfmc_ros.errors import GeometryError
from ivfmc_ros.inspection import features
from ivfmc_ros.meshing.geometry import normals as triangle_normals
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints

# Triangles that meet at a flatter angle than this (radians) belong to one face.
_SMOOTH = np.radians(20.0)
# A face is what fits to this share of its own size.
_EXACT = 2e-4
# The normals of a cone lie on one circle; those of a sphere stand out of every circle by more.
_BENT = 0.01
_MOST = 200
_LEAST_AREA = 5e-4  # share of the surface: smaller faces are not listed


@dataclass(frozen=True, eq=False, kw_only=True)
class Region:
    """
    One face of a nominal.

    name : such as 'cylinder 3'; faces : (k,) of the nominal; area : square metres
    shape : the feature that its vertices make, or None if it is free form
    """

    name: str
    faces: Ints
    area: float
    shape: features.Feature | None


def regions_of(vertices_xyz: Floats, faces: Ints) -> list[Region]:
    """Return the faces of a nominal, the largest first, without tiny ones."""
    label = _smooth_pieces(vertices_xyz, faces)
    corners = vertices_xyz[faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * np.linalg.norm(across, axis=1)
    total = np.bincount(label, area)
    found: list[Region] = []
    for piece in np.argsort(-total)[:_MOST]:
        if total[piece] < _LEAST_AREA * total.sum():
            break
        chosen = np.flatnonzero(label == piece)
        shape = _shape(vertices_xyz, faces[chosen])
        kind = 'free form' if shape is None else shape.kind
        number = 1 + sum(region.name.startswith(kind) for region in found)
        found.append(
            Region(name=f'{kind} {number}', faces=chosen, area=float(total[piece]), shape=shape)
        )
    return found


def _smooth_pieces(vertices: Floats, faces: Ints) -> Ints:
    normal = np.nan_to_num(triangle_normals.of_faces(vertices, faces))
    edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    same = (edges[order[1:]] == edges[order[:-1]]).all(axis=1)
    first, second = order[:-1][same] // 3, order[1:][same] // 3
    smooth = (normal[first] * normal[second]).sum(axis=1) > np.cos(_SMOOTH)
    graph = coo_array(
        (np.ones(int(smooth.sum())), (first[smooth], second[smooth])), shape=(len(faces),) * 2
    )
    _, label = connected_components(graph, directed=False)
    return np.asarray(label, dtype=np.int64)


def _shape(vertices: Floats, faces: Ints) -> features.Feature | None:
    """Return the simplest shape on which all corners of a face lie, with its normals."""
    points = vertices[np.unique(faces)]
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    chosen = points[:: max(1, len(points) // 2000)]
    for kind in ('plane', 'cylinder', 'sphere'):
        try:
            found = features.fit(kind, chosen)
        except GeometryError:
            continue
        if found.form < _EXACT * size and _faces_along(found, vertices, faces):
            return found
    return None


def _faces_along(shape: features.Feature, vertices: Floats, faces: Ints) -> bool:
    """Tell whether the faces are square to the shape's radii: those of a cone are not."""
    if shape.kind == 'plane':
        return True
    normal = np.nan_to_num(triangle_normals.of_faces(vertices, faces))
    if shape.kind == 'sphere' and np.std(normal @ _least_axis(normal)) < _BENT:
        # two rings of corners lie on a sphere whatever they are; this is a chamfer
        return False
    radius = vertices[faces].mean(axis=1) - shape.center_xyz
    if shape.kind == 'cylinder':
        radius = radius - (radius @ shape.axis)[:, None] * shape.axis
    radius /= np.linalg.norm(radius, axis=1, keepdims=True)
    return bool(np.median(np.abs((radius * normal).sum(axis=1))) > np.cos(_SMOOTH))


def _least_axis(vectors: Floats) -> Floats:
    """Return the unit direction in which (n, 3) vectors differ least."""
    return np.asarray(np.linalg.eigh(np.cov(vectors.T))[1][:, 0])
