# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Surface nets (Gibson 1998): the zero surface of a signed distance on sparse blocks, as quads.

There is one quad for each edge between neighboring voxels of different sign, and one vertex for
each cell of eight voxels: the mean of the zero crossings of its edges. With one vertex per cell
the surface is a 2-manifold if and only if the signs form a well-composed image (Latecki 1997),
which has no critical cells: cells with two diagonal voxels of one sign across a face, or across
the cell. Where noise makes a critical cell, the sign of the voxel nearest to the surface is
flipped.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ivfmc_ros.meshing.geometry import topology
from ivfmc_ros.meshing.parallel import run_chunked
from ivfmc_ros.meshing.tsdf.blocks import BLOCK_SIDE
from ivfmc_ros.meshing.tsdf.blocks import BLOCK_VOXELS
from ivfmc_ros.meshing.tsdf.blocks import VoxelBlocks
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Singles

_CORNERS = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
_CHUNK = 1 << 15  # edges
_MAX_ITERATIONS = 60  # of flipping signs
# After so many iterations voxels flip to inside only, which is certain to terminate.
_TWO_WAY_ITERATIONS = 12
# Least distance (voxels) of a flipped voxel, so that the surface does not touch it.
_MIN_FLIPPED = 0.05
# Range of the zero crossing along an edge; at a voxel itself quads of several edges would meet.
_MIN_CROSSING, _MAX_CROSSING = 0.02, 0.98


@dataclass(frozen=True, eq=False, kw_only=True)
class QuadSurface:
    """
    A closed surface of quads.

    vertices : (n, 3) float64, voxel coordinates; each vertex lies in its own cell
    quads : (m, 4) int64, counter-clockwise seen from outside
    cells : (n, 3) int64, the voxel at the lower corner of the cell of each vertex
    """

    vertices: Floats
    quads: Ints
    cells: Ints


def extract_surface(blocks: VoxelBlocks, values: Singles) -> QuadSurface:
    """
    Extract the surface where the signed distance changes its sign.

    values : (blocks, 8, 8, 8) float32, positive outside, no zeros; changed in critical cells
    """
    edges, critical = _find_edges(blocks, values)
    if _make_well_composed(blocks, values, blocks.voxels(critical)):
        edges, _ = _find_edges(blocks, values)
    blocks, around = _cells_around(blocks, edges)
    used = np.zeros(len(blocks) * BLOCK_VOXELS, dtype=bool)
    used[around] = True
    cells = np.flatnonzero(used)
    number = np.empty(len(used), dtype=np.int32)
    number[cells] = np.arange(len(cells), dtype=np.int32)
    quads = np.empty_like(around)

    def renumber(chunk: slice) -> None:
        quads[chunk] = number.take(around[chunk])

    run_chunked(renumber, len(quads), _CHUNK)
    total = topology.face_to_vertex_sum(quads, len(cells)) @ _crossings(blocks, values, edges)
    count = np.bincount(quads.ravel(), minlength=len(cells))
    return QuadSurface(vertices=total / count[:, None], quads=quads, cells=blocks.voxels(cells))


@dataclass(frozen=True, eq=False, kw_only=True)
class _Edges:
    """
    Edges between neighboring voxels of different sign, in the order of their first voxels.

    first : (n,) flat indices of the voxels that are lower along ``axis``
    axis : (n,) int64
    rising : (n,) bool, the second voxel is outside
    """

    first: Ints
    axis: Ints
    rising: Bools


def _find_edges(blocks: VoxelBlocks, values: Singles) -> tuple[_Edges, Ints]:
    """Return all edges of different sign, and the flat indices of critical cells."""
    outside = values > 0
    # bit 4 i + 2 j + k is the sign of the voxel (i, j, k) further
    codes = outside.view(np.uint8)
    for axis, shift in ((2, 1), (1, 2), (0, 4)):
        codes = codes | (_following(blocks, codes, axis) << np.uint8(shift))
    codes = codes.reshape(-1)
    # neither all inside nor all outside
    mixed = np.flatnonzero((codes + np.uint8(1)) > 1)
    code = codes[mixed]
    differs = ((code[:, None] >> np.array([4, 2, 1], dtype=np.uint8)) ^ code[:, None]) & 1
    edge = np.flatnonzero(differs)
    first = edge // 3
    edges = _Edges(first=mixed[first], axis=edge % 3, rising=(code[first] & 1) == 0)
    return edges, mixed[_CRITICAL[code]]


def _following(blocks: VoxelBlocks, values: NDArray[np.uint8], axis: int) -> NDArray[np.uint8]:
    """Return the value of the next voxel along ``axis``; the own value where there is none."""
    following = np.empty_like(values)
    own, after = np.moveaxis(values, axis + 1, 1), np.moveaxis(following, axis + 1, 1)
    after[:, :-1] = own[:, 1:]
    slot = blocks.neighbor_slots(axis, 1)
    after[:, -1] = own[np.maximum(slot, 0), 0]
    after[slot < 0, -1] = own[slot < 0, -1]
    return following


def _crossings(blocks: VoxelBlocks, values: Singles, edges: _Edges) -> Floats:
    """Return (n, 3) voxel coordinates of the zero crossings of the edges."""
    crossings = np.empty((len(edges.first), 3))
    flat, ahead = values.reshape(-1), blocks.voxel_stepper(1)

    def interpolate(chunk: slice) -> None:
        first, axis = edges.first[chunk], edges.axis[chunk]
        a = flat.take(first).astype(np.float64)
        b = flat.take(ahead(first, axis)).astype(np.float64)
        at = blocks.voxels(first).astype(np.float64)
        at[np.arange(len(a)), axis] += np.clip(a / (a - b), _MIN_CROSSING, _MAX_CROSSING)
        crossings[chunk] = at

    run_chunked(interpolate, len(crossings), _CHUNK)
    return crossings


def _cells_around(blocks: VoxelBlocks, edges: _Edges) -> tuple[VoxelBlocks, Ints]:
    """Return the blocks that contain all cells around edges, and (n, 4) flat indices of these."""
    around = _cell_indices(blocks, edges)
    missing = (around < 0).any(axis=1)
    if missing.any():
        mask = np.zeros(blocks.grid.shape, dtype=bool)
        cells = blocks.voxels(edges.first[missing])[:, None] - _CORNERS
        mask[tuple((cells.reshape(-1, 3) // BLOCK_SIDE).T)] = True
        blocks = blocks.extended(mask)
        around = _cell_indices(blocks, edges)
    return blocks, around


def _cell_indices(blocks: VoxelBlocks, edges: _Edges) -> Ints:
    """Return (n, 4) flat indices of the cells around edges; -1 where no block exists."""
    around = np.empty((len(edges.first), 4), dtype=np.int64)
    back = blocks.voxel_stepper(-1)

    def compute(chunk: slice) -> None:
        own, b, c = edges.first[chunk], (edges.axis[chunk] + 1) % 3, (edges.axis[chunk] + 2) % 3
        before = back(own, b)
        # counter-clockwise about the axis
        cells = np.stack([own, before, back(before, c), back(own, c)], axis=1)
        around[chunk] = np.where(edges.rising[chunk, None], cells, cells[:, ::-1])

    run_chunked(compute, len(around), _CHUNK)
    return around


def _make_well_composed(blocks: VoxelBlocks, values: Singles, cells: Ints) -> bool:
    """Flip signs of ``values`` until none of the cells is critical; return if any was flipped."""
    flat = values.reshape(-1)
    for iteration in range(_MAX_ITERATIONS):
        corners = (cells[:, None] + _CORNERS[None]).reshape(-1, 3)
        index = blocks.flat_indices(corners).reshape(-1, 8)
        code = ((flat[index] > 0) & (index >= 0)) @ (1 << np.arange(8))
        critical = _CRITICAL[code] & (index >= 0).all(axis=1)
        if not critical.any():
            return iteration > 0
        index = index[critical]
        size = np.abs(flat[index])
        if iteration >= _TWO_WAY_ITERATIONS:
            size = np.where(flat[index] > 0, size, np.inf)
        chosen = np.unique(index[np.arange(len(index)), size.argmin(axis=1)])
        flat[chosen] = -np.copysign(np.maximum(np.abs(flat[chosen]), _MIN_FLIPPED), flat[chosen])
        near = blocks.voxels(chosen)[:, None] - _CORNERS[None]
        cells = np.unique(near.reshape(-1, 3), axis=0)
    return True


def _is_critical(code: int) -> bool:
    """Return if a cell whose corner k has the sign in bit k of ``code`` is critical."""
    sign = np.array([(code >> k) & 1 for k in range(8)]).reshape(2, 2, 2)
    faces = [np.take(sign, end, axis=axis) for axis in range(3) for end in (0, 1)]
    diagonal = any(f[0, 0] == f[1, 1] != f[0, 1] == f[1, 0] for f in faces)
    flat = sign.reshape(-1)
    opposite = any(flat[k] == flat[7 - k] and (flat == flat[k]).sum() == 2 for k in range(4))
    return bool(diagonal or opposite)


_CRITICAL: Bools = np.array([_is_critical(code) for code in range(256)])
