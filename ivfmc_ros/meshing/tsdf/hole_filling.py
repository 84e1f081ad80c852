# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Hole filling by volumetric diffusion on a coarse grid (Davis et al. 2002).

The signed distance of the samples is computed on coarse cells and diffused to where there are no
samples, so that its zero surface spans each hole. Cells on lines of sight are outside (Curless &
Levoy 1996).
"""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ivfmc_ros.meshing.parallel import map_chunked
from ivfmc_ros.meshing.parallel import run_chunked
from ivfmc_ros.meshing.samples.surface_samples import SurfaceSamples
from ivfmc_ros.meshing.tsdf.blocks import BLOCK_SIDE
from ivfmc_ros.meshing.tsdf.blocks import ravel_index
from ivfmc_ros.meshing.tsdf.blocks import VoxelBlocks
from ivfmc_ros.meshing.tsdf.blocks import VoxelGrid
from ivfmc_ros.meshing.tsdf.signed_distance import SampleSums
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Singles

# With more coarse cells, hole filling would take longer than all other steps.
_MAX_CELLS = 3_000_000
_KERNEL = np.array([0.25, 0.5, 0.25])  # coarse cells
_TRUNCATION = 1.5  # coarse cells; distances are clipped to this
_ITERATIONS = 25  # of diffusion
_CHUNK = 8  # layers of coarse cells
_MAX_RAYS = 40_000  # samples whose lines of sight are followed


@dataclass(frozen=True, eq=False, kw_only=True)
class CoarseDistance:
    """
    A truncated signed distance everywhere in a voxel grid.

    values : (x, y, z) float32, voxels of the grid, positive outside
    cell : 4 or 8, voxels along a coarse cell; cell (0, 0, 0) begins at voxel (0, 0, 0)
    """

    values: Singles
    cell: int


def fill_holes(
    blocks: VoxelBlocks, sums: SampleSums, empty: Bools, floor: float | None
) -> CoarseDistance:
    """
    Return the coarse signed distance of all samples, diffused to where there are none.

    empty : (x, y, z) bool, coarse cells that are known to be outside
    floor : meters, height of the platter, through which the walls of the part are continued; None
        if the part does not stand on one
    """
    cell = coarse_cell(blocks.grid)
    known = _coarse_distance(blocks, sums, cell)
    known = np.where(np.isnan(known) & empty, np.float32(_TRUNCATION), known)
    if floor is None:
        values = _diffused(known, stands=False) * np.float32(cell)
        return CoarseDistance(values=values, cell=cell)
    level = (floor - blocks.grid.origin[2]) / blocks.grid.voxel
    first = int(np.clip(level / cell, 0, known.shape[2] - 2))
    above = _diffused(known[:, :, first:], stands=True) * np.float32(cell)
    values = np.pad(above, ((0, 0), (0, 0), (first, 0)), mode='edge')
    return CoarseDistance(values=values, cell=cell)


def coarse_cell(grid: VoxelGrid) -> int:
    """Return the edge of a coarse cell in voxels, 4 or 8."""
    cells = float(np.prod(np.array(grid.shape, dtype=np.float64))) * 8.0
    return 4 if cells <= _MAX_CELLS else 8


def _coarse_distance(blocks: VoxelBlocks, sums: SampleSums, cell: int) -> Singles:
    """Return the distance in coarse cells where there are samples, NaN elsewhere."""
    shape = tuple(side * BLOCK_SIDE // cell for side in blocks.grid.shape)
    index = ravel_index(blocks.voxels(sums.indices) // cell, shape)

    def gather(column: slice) -> Singles:
        dense = np.bincount(index, sums.planes[:, column.start], minlength=int(np.prod(shape)))
        return _blurred(dense.astype(np.float32).reshape(shape))

    weight, offset, *normals = map_chunked(gather, 5, 1)
    top = -offset
    for axis in range(3):
        center = np.arange(shape[axis], dtype=np.float32) * cell + 0.5 * (cell - 1)
        top += normals[axis] * center.reshape(np.roll((-1, 1, 1), axis))
    with np.errstate(invalid='ignore', divide='ignore'):
        distance = top / weight / cell
    clipped = np.clip(distance, -_TRUNCATION, _TRUNCATION)
    return np.where(weight > 1e-6, clipped, np.nan).astype(np.float32)


def _blurred(dense: Singles) -> Singles:
    for axis in range(3):
        dense = ndimage.correlate1d(dense, _KERNEL, axis=axis, mode='constant')
    return dense


def _diffused(known: Singles, stands: bool) -> Singles:
    """
    Diffuse the values of ``known`` into its NaN cells; the border of the grid is outside.

    stands : the border below is left free, because the part continues through the platter
    """
    known = known.copy()
    for axis in range(3):
        border: list[slice | int] = [slice(None)] * 3
        for end in (0, -1):
            if stands and axis == 2 and end == 0:
                continue
            border[axis] = end
            known[tuple(border)] = _TRUNCATION
    free = np.isnan(known)
    # start from the nearest known value: its sign is right except near holes
    nearest = ndimage.distance_transform_edt(free, return_distances=False, return_indices=True)
    values = known[tuple(nearest)]
    after = np.empty_like(values)

    def iterate(layers: slice) -> None:
        mean = _mean_of_neighbors(values, layers)
        after[layers] = np.where(free[layers], mean, known[layers])

    for _ in range(_ITERATIONS):
        run_chunked(iterate, len(values), _CHUNK)
        values, after = after, values
    return np.asarray(values)


def _mean_of_neighbors(values: Singles, layers: slice) -> Singles:
    """Return the mean of the six neighbors of the cells in some layers; edges are replicated."""
    rows = np.clip(np.arange(layers.start - 1, layers.stop + 1), 0, len(values) - 1)
    padded = np.pad(values[rows], ((0, 0), (1, 1), (1, 1)), mode='edge')
    total = padded[2:, 1:-1, 1:-1] + padded[:-2, 1:-1, 1:-1]
    total += padded[1:-1, 2:, 1:-1]
    total += padded[1:-1, :-2, 1:-1]
    total += padded[1:-1, 1:-1, 2:]
    total += padded[1:-1, 1:-1, :-2]
    return np.asarray(total * np.float32(1.0 / 6.0))


def observed_free_space(grid: VoxelGrid, samples: SurfaceSamples) -> Bools:
    """Return (x, y, z) bool, the coarse cells that lines of sight to samples pass through."""
    cell = coarse_cell(grid)
    shape = tuple(side * BLOCK_SIDE // cell for side in grid.shape)
    free = np.zeros(shape, dtype=bool)
    stride = max(1, len(samples) // _MAX_RAYS)
    at = (grid.to_voxels(samples.points_xyz[::stride]) + 0.5) / cell
    to_camera = samples.to_camera[::stride]
    # begin above the surface, because a cell that contains surface is not free
    at = at + 2.0 * samples.normals[::stride]
    for _ in range(int(2.0 * max(shape))):
        inside = ((at >= 0) & (at < shape)).all(axis=1)
        at, to_camera = at[inside], to_camera[inside]
        if not len(at):
            break
        free[tuple(at.astype(np.int64).T)] = True
        at = at + to_camera
    return free
