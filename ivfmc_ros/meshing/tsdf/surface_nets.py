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
from numpy.typing import NDArray

from ivfmc_ros.meshing.geometry import topology
from ivfmc_ros.meshing.parallel import in_parts
from ivfmc_ros.meshing.tsdf.blocks import Blocks
from ivfmc_ros.meshing.tsdf.blocks import SIDE
from ivfmc_ros.meshing.tsdf.blocks import VOLUME
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Singles

_CORNERS = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
_AT_ONCE = 1 << 15  # edges
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
    edges, crossed = _edges(blocks, values)
    if _uncross(blocks, values, blocks.voxels(crossed)):
        edges, _ = _edges(blocks, values)
    blocks, around = _cells_around(blocks, edges)
    used = np.zeros(len(blocks) * VOLUME, dtype=bool)
    used[around] = True
    cells = np.flatnonzero(used)
    number = np.empty(len(used), dtype=np.int32)
    number[cells] = np.arange(len(cells), dtype=np.int32)
    quads = np.empty_like(around)

    def name(some: slice) -> None:
        quads[some] = number.take(around[some])

    in_parts(name, len(quads), _AT_ONCE)
    total = topology.adding(quads, len(cells)) @ _crossing(blocks, values, edges)
    count = np.bincount(quads.ravel(), minlength=len(cells))
    return Nets(vertices=total / count[:, None], quads=quads, cells=blocks.voxels(cells))


@dataclass(frozen=True, eq=False, kw_only=True)
class _Edges:
    """
    Edges between neighbouring voxels of different sign, in the order of the first voxels.

    first : (n,) places of the voxels that are lower along ``axis``
    axis : (n,) int64
    rising : (n,) bool, the second voxel is outside
    """

    first: Ints
    axis: Ints
    rising: Bools


def _edges(blocks: Blocks, values: Singles) -> tuple[_Edges, Ints]:
    """Return all edges, and the places of cells that have their signs crosswise."""
    outside = values > 0
    # bit 4 i + 2 j + k is the sign of the voxel (i, j, k) further
    codes = outside.view(np.uint8)
    for axis, shift in ((2, 1), (1, 2), (0, 4)):
        codes = codes | (_following(blocks, codes, axis) << np.uint8(shift))
    codes = codes.reshape(-1)
    # neither all inside nor all outside
    some = np.flatnonzero((codes + np.uint8(1)) > 1)
    code = codes[some]
    differs = ((code[:, None] >> np.array([4, 2, 1], dtype=np.uint8)) ^ code[:, None]) & 1
    edge = np.flatnonzero(differs)
    first = edge // 3
    edges = _Edges(first=some[first], axis=edge % 3, rising=(code[first] & 1) == 0)
    return edges, some[_CROSSWISE[code]]


def _following(blocks: Blocks, values: NDArray[np.uint8], axis: int) -> NDArray[np.uint8]:
    """Return of each voxel the value of the next along ``axis``; its own where there is none."""
    following = np.empty_like(values)
    own, after = np.moveaxis(values, axis + 1, 1), np.moveaxis(following, axis + 1, 1)
    after[:, :-1] = own[:, 1:]
    slot = blocks.neighbour(axis, 1)
    after[:, -1] = own[np.maximum(slot, 0), 0]
    after[slot < 0, -1] = own[slot < 0, -1]
    return following


def _crossing(blocks: Blocks, values: Singles, edges: _Edges) -> Floats:
    """Return (n, 3) where the surface crosses the edges, in voxels."""
    crossing = np.empty((len(edges.first), 3))
    flat, ahead = values.reshape(-1), blocks.steps(1)

    def cross(some: slice) -> None:
        first, axis = edges.first[some], edges.axis[some]
        a = flat.take(first).astype(np.float64)
        b = flat.take(ahead(first, axis)).astype(np.float64)
        there = blocks.voxels(first).astype(np.float64)
        # not at a voxel itself, where quadrilaterals of several edges would meet
        there[np.arange(len(a)), axis] += np.clip(a / (a - b), 0.02, 0.98)
        crossing[some] = there

    in_parts(cross, len(crossing), _AT_ONCE)
    return crossing


def _cells_around(blocks: Blocks, edges: _Edges) -> tuple[Blocks, Ints]:
    """Return (n, 4) places of the cells around edges, and the blocks that these are in."""
    around = _ring(blocks, edges)
    without = (around < 0).any(axis=1)
    if without.any():
        wanted = np.zeros(blocks.grid.shape, dtype=bool)
        near = blocks.voxels(edges.first[without])[:, None] - _CORNERS
        wanted[tuple((near.reshape(-1, 3) // SIDE).T)] = True
        blocks = blocks.joined(wanted)
        around = _ring(blocks, edges)
    return blocks, around


def _ring(blocks: Blocks, edges: _Edges) -> Ints:
    ring = np.empty((len(edges.first), 4), dtype=np.int64)
    back = blocks.steps(-1)

    def go_round(some: slice) -> None:
        own, b, c = edges.first[some], (edges.axis[some] + 1) % 3, (edges.axis[some] + 2) % 3
        before = back(own, b)
        # counter-clockwise about the axis
        cells = np.stack([own, before, back(before, c), back(own, c)], axis=1)
        ring[some] = np.where(edges.rising[some, None], cells, cells[:, ::-1])

    in_parts(go_round, len(ring), _AT_ONCE)
    return ring


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
