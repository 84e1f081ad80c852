# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The zero set of a distance on blocks.

There is one quadrilateral for each edge between voxels of different sign, and one vertex for each
cell (surface nets, Gibson 1998).

With one vertex a cell the surface is a 2-manifold if and only if no cell has its signs crosswise
(well-composed images, Latecki 1997). Where noise makes such a cell, the voxel that is nearest to
the surface changes its sign.
"""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.meshing.blocks import Blocks
from ivfmc_ros.meshing.blocks import SIDE
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Singles

_CORNERS = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
# Signs that are crosswise change along at least so many of the twelve edges of a cell.
_LEAST_CROSSED = 6
_ROUNDS = 60
# rounds after which voxels change to inside only, which must come to an end
_FREE_ROUNDS = 12


@dataclass(frozen=True, eq=False, kw_only=True)
class Nets:
    """
    A closed surface of quadrilaterals.

    vertices : (n, 3) in voxels; each lies in its own cell
    quads : (m, 4), counter-clockwise seen from outside
    cells : (n, 3) int64, the voxel at the lower corner of each vertex' cell
    """

    vertices: Floats
    quads: Ints
    cells: Ints


def extract(blocks: Blocks, values: Singles) -> Nets:
    """
    Return the surface where (blocks, 8, 8, 8) ``values`` change their sign.

    values : outside positive, no zeros; changed where signs are crosswise
    """
    edges = _edges(blocks, values)
    cells, corner = _cells(edges, blocks)
    if _uncross(blocks, values, cells[np.bincount(corner.ravel()) >= _LEAST_CROSSED]):
        edges = _edges(blocks, values)
        cells, corner = _cells(edges, blocks)
    crossing = np.concatenate([_crossing(blocks, values, edge) for edge in edges])
    total = np.stack(
        [
            np.bincount(corner.ravel(), np.repeat(crossing[:, k], 4), minlength=len(cells))
            for k in range(3)
        ],
        axis=1,
    )
    count = np.bincount(corner.ravel(), minlength=len(cells))
    return Nets(vertices=total / count[:, None], quads=corner, cells=cells)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Edges:
    """Edges along an axis with a change of sign: places of both voxels, and the first voxel."""

    axis: int
    first: Ints
    second: Ints
    rising: Bools
    voxels: Ints


def _edges(blocks: Blocks, values: Singles) -> list[_Edges]:
    return [_edges_along(blocks, values, axis) for axis in range(3)]


def _edges_along(blocks: Blocks, values: Singles, axis: int) -> _Edges:
    outside = values > 0
    after = blocks.neighbour(axis, 1)
    following = np.roll(outside, -1, axis=axis + 1)
    first_layer = np.take(outside, 0, axis=axis + 1)[after]
    own = np.take(outside, SIDE - 1, axis=axis + 1)
    last: list[slice | int] = [slice(None)] * 4
    last[axis + 1] = SIDE - 1
    following[tuple(last)] = np.where((after >= 0)[:, None, None], first_layer, own)
    first = np.flatnonzero(outside != following)
    voxels = blocks.voxels(first)
    ahead = voxels.copy()
    ahead[:, axis] += 1
    return _Edges(
        axis=axis,
        first=first,
        second=blocks.place(ahead),
        rising=following.reshape(-1)[first],
        voxels=voxels,
    )


def _crossing(blocks: Blocks, values: Singles, edge: _Edges) -> Floats:
    """Return (n, 3) where the surface crosses the edges, in voxels."""
    flat = values.reshape(-1)
    a, b = flat[edge.first].astype(np.float64), flat[edge.second].astype(np.float64)
    crossing = edge.voxels.astype(np.float64)
    # not at a voxel itself, where quadrilaterals of several edges would meet
    crossing[:, edge.axis] += np.clip(a / (a - b), 0.02, 0.98)
    return crossing


def _cells(edges: list[_Edges], blocks: Blocks) -> tuple[Ints, Ints]:
    """Return the (n, 3) cells around the edges, and (m, 4) which of them is around each edge."""
    shape = np.array(blocks.grid.shape) * SIDE
    around = []
    for edge in edges:
        b, c = (edge.axis + 1) % 3, (edge.axis + 2) % 3
        stride = np.array([shape[1] * shape[2], shape[2], 1])
        own = edge.voxels @ stride
        # counter-clockwise about the axis
        ring = own[:, None] - np.array([0, stride[b], stride[b] + stride[c], stride[c]])
        around.append(np.where(edge.rising[:, None], ring, ring[:, ::-1]))
    ids, corner = np.unique(np.concatenate(around), return_inverse=True)
    cells = np.stack(np.unravel_index(ids, tuple(shape)), axis=1).astype(np.int64)
    return cells, corner.reshape(-1, 4)


def _uncross(blocks: Blocks, values: Singles, cells: Ints) -> bool:
    """Change the sign of voxels until no cell has its signs crosswise; tell if any changed."""
    flat = values.reshape(-1)
    for turn in range(_ROUNDS):
        place = blocks.place((cells[:, None] + _CORNERS[None]).reshape(-1, 3)).reshape(-1, 8)
        code = ((flat[place] > 0) & (place >= 0)) @ (1 << np.arange(8))
        crossed = _CROSSWISE[code] & (place >= 0).all(axis=1)
        if not crossed.any():
            return turn > 0
        place = place[crossed]
        size = np.abs(flat[place])
        if turn >= _FREE_ROUNDS:
            size = np.where(flat[place] > 0, size, np.inf)
        chosen = np.unique(place[np.arange(len(place)), size.argmin(axis=1)])
        # far enough from 0 that the surface does not come to lie on the voxel
        flat[chosen] = -np.copysign(np.maximum(np.abs(flat[chosen]), 0.05), flat[chosen])
        near = blocks.voxels(chosen)[:, None] - _CORNERS[None]
        cells = np.unique(near.reshape(-1, 3), axis=0)
    return True


def _crosswise(code: int) -> bool:
    sign = np.array([(code >> k) & 1 for k in range(8)]).reshape(2, 2, 2)
    faces = [np.take(sign, end, axis=axis) for axis in range(3) for end in (0, 1)]
    diagonal = any(f[0, 0] == f[1, 1] != f[0, 1] == f[1, 0] for f in faces)
    flat = sign.reshape(-1)
    opposite = any(flat[k] == flat[7 - k] and (flat == flat[k]).sum() == 2 for k in range(4))
    return bool(diagonal or opposite)


_CROSSWISE: Bools = np.array([_crosswise(code) for code in range(256)])
