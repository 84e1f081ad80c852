# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A mesh with fewer triangles, to look at."""

import numpy as np

from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints

_COARSER = 1.25


def thinned(vertices_xyz: Floats, faces: Ints, most: int) -> tuple[Floats, Ints]:
    """
    Return a mesh of at most ``most`` triangles: vertices that share a voxel become one.

    It is fast, and good enough to look at; it is no simplification to measure by.

    vertices_xyz : (n, 3) metres; faces : (m, 3)
    """
    if len(faces) <= most:
        return vertices_xyz, faces
    low = vertices_xyz.min(axis=0)
    # on a surface the number of voxels goes with the square of their edge
    edge = _mean_edge(vertices_xyz, faces) * np.sqrt(len(faces) / max(most, 1))
    while True:
        cells = np.floor((vertices_xyz - low) / edge).astype(np.int64)
        _, place, count = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
        place = place.ravel()
        coarse = _without_collapsed(place[faces])
        if len(coarse) <= most:
            break
        edge *= _COARSER
    sums = [np.bincount(place, vertices_xyz[:, axis]) for axis in range(3)]
    return np.stack(sums, axis=1) / count[:, None], coarse


def _mean_edge(vertices_xyz: Floats, faces: Ints) -> float:
    along = vertices_xyz[faces[:, 0]] - vertices_xyz[faces[:, 1]]
    return float(np.linalg.norm(along, axis=1).mean())


def _without_collapsed(faces: Ints) -> Ints:
    a, b, c = faces.T
    return np.asarray(faces[(a != b) & (b != c) & (c != a)])
