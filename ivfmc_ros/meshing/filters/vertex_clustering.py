# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Fast mesh simplification for display by vertex clustering (Rossignac & Borrel 1993).

Vertices in one cell of a cubic grid are merged into their mean. The result is no 2-manifold and
has no bounded deviation: it is for display only.
"""

import numpy as np

from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints

_CELL_GROWTH = 1.25  # factor on the cell size while there are too many triangles
_CELLS_PER_EXTENT = 0.8  # first number of cells along the part, times the root of the triangles
# One number for the place of a cell: the part has less than 2^20 of them along each axis.
_KEY = np.array([1, 1 << 20, 1 << 40])
_CELLS_SHRINK = 0.75  # factor on that number while there are too many triangles


def cluster_vertices(vertices_xyz: Floats, faces: Ints, max_faces: int) -> tuple[Floats, Ints]:
    """
    Merge vertices in cells whose size is chosen from the mean edge length of the mesh.

    vertices_xyz : (n, 3) float64, meters
    faces : (m, 3) int64
    returns : vertices and at most ``max_faces`` faces; the given ones if these are few enough
    """
    if len(faces) <= max_faces:
        return vertices_xyz, faces
    low = vertices_xyz.min(axis=0)
    # on a surface the number of occupied cells is inverse to the square of their size
    size = _mean_edge(vertices_xyz, faces) * np.sqrt(len(faces) / max(max_faces, 1))
    while True:
        cells = np.floor((vertices_xyz - low) / size).astype(np.int64) @ _KEY
        _, cluster, count = np.unique(cells, return_inverse=True, return_counts=True)
        cluster = cluster.ravel()
        coarse = _without_collapsed(cluster[faces])
        if len(coarse) <= max_faces:
            break
        size *= _CELL_GROWTH
    sums = [np.bincount(cluster, vertices_xyz[:, axis]) for axis in range(3)]
    return np.stack(sums, axis=1) / count[:, None], coarse


def cluster_vertices_with_values(
    vertices_xyz: Floats, faces: Ints, values: Floats, max_faces: int
) -> tuple[Floats, Ints, Floats]:
    """
    Merge vertices and average their values, in cells whose size is chosen from the extent.

    vertices_xyz : (n, 3) float64, meters
    faces : (m, 3) int64
    values : (n,) of the vertices; merged vertices get the mean of the finite ones
    returns : vertices, at most ``max_faces`` faces, values
    """
    size = float(np.ptp(vertices_xyz, axis=0).max(initial=0.0))
    cells = np.sqrt(max_faces) * _CELLS_PER_EXTENT
    while len(faces) > max_faces:
        key = np.round((vertices_xyz - vertices_xyz.min(axis=0)) / max(size, 1e-12) * cells)
        key = key.astype(np.int64) @ _KEY
        _, cluster, count = np.unique(key, return_inverse=True, return_counts=True)
        total = np.stack([np.bincount(cluster, vertices_xyz[:, k]) for k in range(3)], axis=1)
        finite = np.isfinite(values)
        known = np.bincount(cluster, finite)
        with np.errstate(invalid='ignore', divide='ignore'):
            values = np.bincount(cluster, np.where(finite, values, 0.0)) / known
        vertices_xyz = total / count[:, None]
        faces = cluster[faces]
        faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
        cells *= _CELLS_SHRINK
    return vertices_xyz, faces, values


def _mean_edge(vertices_xyz: Floats, faces: Ints) -> float:
    edges = vertices_xyz[faces[:, 0]] - vertices_xyz[faces[:, 1]]
    return float(np.linalg.norm(edges, axis=1).mean())


def _without_collapsed(faces: Ints) -> Ints:
    """Return the faces that still have three different vertices."""
    a, b, c = faces.T
    return np.asarray(faces[(a != b) & (b != c) & (c != a)])
