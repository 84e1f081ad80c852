# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which pieces of a surface belong to the part."""

from collections.abc import Iterator

import numpy as np
from scipy.spatial import cKDTree

from ivfmc_ros.meshing import topology
from ivfmc_ros.model import Bools
from ivfmc_ros.model import BRIDGED
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Kinds

# A closed piece beside the largest of which less was seen is a flying scrap, grown to a body.
_LEAST_SEEN = 0.3
# A piece of a smaller share of the whole that is farther (voxels) from all larger ones flies.
# In the measured scan it is 0.9 % and 46 voxels; real pieces are within 3 voxels of others.
_SMALL, _FAR = 0.02, 20.0


def solid(quads: Ints, kind: Kinds, vertices: int, least: int) -> Bools:
    """Tell which quads are in a piece that is large enough and was seen in part."""
    if not len(quads):
        return np.zeros(0, dtype=bool)
    piece = topology.pieces(quads, vertices)
    size = np.bincount(piece)
    seen = np.bincount(piece, kind <= BRIDGED) / np.maximum(size, 1)
    wanted = np.where(size == size.max(), 0.0, _LEAST_SEEN)
    return np.asarray(((size >= least) & (seen >= wanted))[piece])


def flying(vertices_xyz: Floats, quads: Ints, voxel: float) -> tuple[Bools, int]:
    """
    Find pieces that are small and far from all that is larger.

    vertices_xyz : (n, 3) metres; quads : (m, 4)
    returns : (m,) bool of the quads, and how many pieces they make
    """
    gone = np.zeros(len(quads), dtype=bool)
    count = 0
    piece = topology.pieces(quads, len(vertices_xyz))
    for own, larger in _small(piece):
        at = vertices_xyz[np.unique(quads[own])]
        rest = vertices_xyz[np.unique(quads[larger & ~gone])]
        gap, _ = cKDTree(rest).query(at, distance_upper_bound=_FAR * voxel)
        if not np.isfinite(gap).any():
            gone |= own
            count += 1
    return gone, count


def _small(piece: Ints) -> Iterator[tuple[Bools, Bools]]:
    """Give the quads of each small piece, and those of larger ones, the largest first."""
    size = np.bincount(piece)
    order = np.argsort(-size, kind='stable')
    for k in range(1, len(order)):
        number = order[k]
        if 0 < size[number] < _SMALL * len(piece):
            yield piece == number, np.isin(piece, order[:k])
