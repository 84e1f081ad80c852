# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Inside or outside where nothing was measured.

On a coarse grid the signed distance is known near the samples; it is continued to the rest, and
diffused there (after Davis et al. 2002), so that its zero set is a skin over each hole. All that
the camera looked through on its way to a sample is outside (Curless & Levoy 1996).
"""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ivfmc_ros.meshing.parallel import each_part
from ivfmc_ros.meshing.parallel import in_parts
from ivfmc_ros.meshing.samples.surface_samples import Samples
from ivfmc_ros.meshing.tsdf.blocks import Blocks
from ivfmc_ros.meshing.tsdf.blocks import flat
from ivfmc_ros.meshing.tsdf.blocks import Grid
from ivfmc_ros.meshing.tsdf.blocks import SIDE
from ivfmc_ros.meshing.tsdf.signed_distance import Sums
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Singles

# A coarse grid of more cells than this takes longer than the samples do.
_MOST_CELLS = 3_000_000
_KERNEL = np.array([0.25, 0.5, 0.25])
_CLIP = 1.5  # coarse cells; farther away the distance is a sign
_SWEEPS = 25
_AT_ONCE = 8  # layers of coarse cells
_RAYS = 40_000


@dataclass(frozen=True, eq=False, kw_only=True)
class Coarse:
    """
    A signed distance everywhere in a grid.

    values : (x, y, z) float32, voxels of the grid, outside positive, clipped
    cell : voxels along a coarse cell, 4 or 8; cell (0, 0, 0) begins at voxel (0, 0, 0)
    """

    values: Singles
    cell: int


def fill(blocks: Blocks, sums: Sums, empty: Bools, floor: float | None) -> Coarse:
    """
    Return the coarse distance of all samples, filled up where there are none.

    empty : (x, y, z) bool by coarse cell, what is certainly outside
    floor : metres, of the plane that the part stands on: its walls go on through that; or None
    """
    cell = coarse_cell(blocks.grid)
    known = _coarse_distance(blocks, sums, cell)
    known = np.where(np.isnan(known) & empty, np.float32(_CLIP), known)
    if floor is None:
        return Coarse(values=_continued(known, stands=False) * np.float32(cell), cell=cell)
    level = (floor - blocks.grid.origin[2]) / blocks.grid.voxel
    first = int(np.clip(level / cell, 0, known.shape[2] - 2))
    above = _continued(known[:, :, first:], stands=True) * np.float32(cell)
    return Coarse(values=np.pad(above, ((0, 0), (0, 0), (first, 0)), mode='edge'), cell=cell)


def coarse_cell(grid: Grid) -> int:
    """Return how many voxels a coarse cell is wide."""
    cells = float(np.prod(np.array(grid.shape, dtype=np.float64))) * 8.0
    return 4 if cells <= _MOST_CELLS else 8


def _coarse_distance(blocks: Blocks, sums: Sums, cell: int) -> Singles:
    """Return the distance in coarse cells where there are samples, NaN elsewhere."""
    shape = tuple(side * SIDE // cell for side in blocks.grid.shape)
    index = flat(blocks.voxels(sums.places) // cell, shape)

    def gathered(column: slice) -> Singles:
        dense = np.bincount(index, sums.planes[:, column.start], minlength=int(np.prod(shape)))
        return _blur(dense.astype(np.float32).reshape(shape))

    weight, offset, *normals = each_part(gathered, 5, 1)
    top = -offset
    for axis in range(3):
        centre = np.arange(shape[axis], dtype=np.float32) * cell + 0.5 * (cell - 1)
        top += normals[axis] * centre.reshape(np.roll((-1, 1, 1), axis))
    with np.errstate(invalid='ignore', divide='ignore'):
        distance = top / weight / cell
    return np.where(weight > 1e-6, np.clip(distance, -_CLIP, _CLIP), np.nan).astype(np.float32)


def _blur(dense: Singles) -> Singles:
    for axis in range(3):
        dense = ndimage.correlate1d(dense, _KERNEL, axis=axis, mode='constant')
    return dense


def _continued(known: Singles, stands: bool) -> Singles:
    """Continue what is known to where ``known`` is NaN, smoothly; the rim is outside."""
    known = known.copy()
    for axis in range(3):
        rim: list[slice | int] = [slice(None)] * 3
        for end in (0, -1):
            if stands and axis == 2 and end == 0:
                continue
            rim[axis] = end
            known[tuple(rim)] = _CLIP
    free = np.isnan(known)
    # the sign of what is nearest is right but for the holes, over which the sweeps draw the skin
    nearest = ndimage.distance_transform_edt(free, return_distances=False, return_indices=True)
    values = known[tuple(nearest)]
    after = np.empty_like(values)

    def sweep(some: slice) -> None:
        after[some] = np.where(free[some], _mean_of_neighbours(values, some), known[some])

    for _ in range(_SWEEPS):
        in_parts(sweep, len(values), _AT_ONCE)
        values, after = after, values
    return np.asarray(values)


def _mean_of_neighbours(values: Singles, some: slice) -> Singles:
    """Return the mean of the six neighbours in some layers; beyond the rim a value goes on."""
    layers = np.clip(np.arange(some.start - 1, some.stop + 1), 0, len(values) - 1)
    padded = np.pad(values[layers], ((0, 0), (1, 1), (1, 1)), mode='edge')
    total = padded[2:, 1:-1, 1:-1] + padded[:-2, 1:-1, 1:-1]
    total += padded[1:-1, 2:, 1:-1]
    total += padded[1:-1, :-2, 1:-1]
    total += padded[1:-1, 1:-1, 2:]
    total += padded[1:-1, 1:-1, :-2]
    return np.asarray(total * np.float32(1.0 / 6.0))


def looked_through(grid: Grid, samples: Samples) -> Bools:
    """Return which coarse cells the camera saw a sample through, (x, y, z) bool."""
    cell = coarse_cell(grid)
    shape = tuple(side * SIDE // cell for side in grid.shape)
    found = np.zeros(shape, dtype=bool)
    stride = max(1, len(samples) // _RAYS)
    at = (grid.coordinates(samples.points_xyz[::stride]) + 0.5) / cell
    sight = samples.sight[::stride]
    # a cell that the surface is in is not empty, however it is seen
    at = at + 2.0 * samples.normals[::stride]
    for _ in range(int(2.0 * max(shape))):
        inside = ((at >= 0) & (at < shape)).all(axis=1)
        at, sight = at[inside], sight[inside]
        if not len(at):
            break
        found[tuple(at.astype(np.int64).T)] = True
        at = at + sight
    return found
