# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which pieces of a surface belong to the part."""

import numpy as np
from scipy.spatial import cKDTree

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


def solid(piece: Ints, kind: Kinds, least: int) -> Bools:
    """Tell which quads are in a piece that is large enough and was seen in part."""
    if not len(piece):
        return np.zeros(0, dtype=bool)
    size = np.bincount(piece)
    seen = np.bincount(piece, kind <= BRIDGED) / np.maximum(size, 1)
    wanted = np.where(size == size.max(), 0.0, _LEAST_SEEN)
    return np.asarray(((size >= least) & (seen >= wanted))[piece])


def flying(vertices_xyz: Floats, quads: Ints, piece: Ints, voxel: float) -> tuple[Bools, int]:
    """
    Find pieces that are small and far from all that is larger, and does not fly itself.

    vertices_xyz : (n, 3) metres; quads : (m, 4); piece : (m,) number of the piece of each
    returns : (m,) bool of the quads, and how many pieces they make
    """
    size = np.bincount(piece)
    order = np.argsort(-size, kind='stable')
    small = size[order] < _SMALL * len(piece)
    small[:1] = False
    order, large = order[small & (size[order] > 0)], order[~small]
    if not len(order):
        return np.zeros(len(quads), dtype=bool), 0
    of_piece = np.full(len(vertices_xyz), -1)
    of_piece[quads] = piece[:, None]
    gone = np.zeros(len(size), dtype=bool)
    gone[_far(vertices_xyz, of_piece, order, large, _FAR * voxel)] = True
    return gone[piece], int(gone.sum())


def _far(vertices_xyz: Floats, of_piece: Ints, order: Ints, large: Ints, reach: float) -> Ints:
    """
    Return which pieces of ``order`` are near no large one, nor one before that is near.

    of_piece : (n,) the piece of each vertex; order : pieces, the largest first
    """
    is_large = np.zeros(int(of_piece.max()) + 1, dtype=bool)
    is_large[large] = True
    rest = vertices_xyz[(of_piece >= 0) & is_large[of_piece]]
    at = _vertices_of(vertices_xyz, of_piece, order)
    gap, _ = cKDTree(rest, balanced_tree=False).query(
        np.concatenate(at), distance_upper_bound=reach
    )
    bounds = np.cumsum([0, *map(len, at)])
    near = np.maximum.reduceat(np.isfinite(gap), bounds[:-1])
    low = np.array([points.min(axis=0) for points in at])
    high = np.array([points.max(axis=0) for points in at])
    for k in np.flatnonzero(~near).tolist():
        beside = near[:k] & ((low[:k] <= high[k] + reach) & (high[:k] >= low[k] - reach)).all(
            axis=1
        )
        tree = cKDTree(at[k])
        near[k] = any(
            np.isfinite(tree.query(at[j], distance_upper_bound=reach)[0]).any()
            for j in np.flatnonzero(beside).tolist()
        )
    return np.asarray(order[~near])


def _vertices_of(vertices_xyz: Floats, of_piece: Ints, order: Ints) -> list[Floats]:
    """Return the vertices of each piece, found by one sort."""
    by_piece = np.argsort(of_piece, kind='stable')
    ordered = of_piece[by_piece]
    first, last = (np.searchsorted(ordered, order, side=side) for side in ('left', 'right'))
    return [vertices_xyz[by_piece[a:b]] for a, b in zip(first, last, strict=True)]
