# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A grid of voxels of which only blocks near a surface exist."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Singles

SIDE = 8  # voxels along a block
_VOLUME = SIDE**3
# Values that a blur takes at a time.
_AT_ONCE = 1 << 16
# A grid of more blocks than this has voxels that are too small for what is in it.
_MOST_BLOCKS = 64_000_000


@dataclass(frozen=True, eq=False, kw_only=True)
class Grid:
    """
    Where the voxels are. Voxel (i, j, k) has its centre at origin + voxel * (i, j, k).

    origin : (3,) metres
    voxel : metres
    shape : blocks along x, y, z
    """

    origin: Floats
    voxel: float
    shape: tuple[int, int, int]

    @classmethod
    def around(cls, low: Floats, high: Floats, voxel: float, margin: int) -> 'Grid':
        """
        Return a grid that holds a box, and ``margin`` voxels around it.

        :raises ParameterError: the voxel is too small for the box
        """
        first = np.floor(low / voxel) - margin
        count = np.ceil((high / voxel - first + margin) / SIDE).astype(np.int64) + 1
        if float(np.prod(count.astype(np.float64))) > _MOST_BLOCKS:
            size = ' x '.join(f'{1e3 * side:.0f}' for side in high - low)
            raise ParameterError(
                f'voxel: {voxel * 1e3:.4g} mm is too small for a part of {size} mm; '
                'raise voxel or restrict the working volume'
            )
        i, j, k = count.tolist()
        return cls(origin=first * voxel, voxel=voxel, shape=(i, j, k))

    def coordinates(self, points_xyz: Floats) -> Floats:
        """Return (n, 3) points in units of voxels."""
        return np.asarray((points_xyz - self.origin) / self.voxel)

    def points(self, coordinates: Floats) -> Floats:
        """Return where (n, 3) coordinates in voxels are, metres."""
        return np.asarray(self.origin + coordinates * self.voxel)


class Blocks:
    """
    Which blocks of a grid exist, in the order of their slots.

    index : (n, 3) int64, of each block in the grid
    slot : grid.shape int32, of the block there; -1 where is none
    """

    def __init__(self, grid: Grid, ids: Ints) -> None:
        self.grid = grid
        self.index: Ints = np.stack(np.unravel_index(ids, grid.shape), axis=1).astype(np.int64)
        self.slot = np.full(grid.shape, -1, dtype=np.int32)
        self.slot.reshape(-1)[ids] = np.arange(len(ids), dtype=np.int32)

    def __len__(self) -> int:
        return len(self.index)

    @classmethod
    def near(cls, grid: Grid, coordinates: Floats, radius: int) -> 'Blocks':
        """Return the blocks of all voxels that are within ``radius`` of (n, 3) coordinates."""
        voxel = np.unique(flat(np.rint(coordinates).astype(np.int64) // 2, _fine(grid, 2)))
        low = np.stack(np.unravel_index(voxel, _fine(grid, 2)), axis=1) * 2
        found = np.zeros(grid.shape, dtype=bool)
        for corner in product((-radius, radius + 1), repeat=3):
            found[tuple(((low + corner) // SIDE).T)] = True
        return cls(grid, np.flatnonzero(found))

    def joined(self, wanted: Bools) -> 'Blocks':
        """Return these blocks, in their slots, and after them those of a grid.shape mask."""
        new = np.flatnonzero(wanted & (self.slot < 0))
        ids = np.concatenate([flat(self.index, self.grid.shape), new])
        return Blocks(self.grid, ids)

    def place(self, voxels: Ints) -> Ints:
        """Return where (n, 3) voxels are in a flat (blocks, 8, 8, 8) array; -1 if nowhere."""
        block, inside = voxels // SIDE, voxels % SIDE
        within: Bools = np.all((block >= 0) & (block < np.array(self.grid.shape)), axis=1)
        block = np.where(within[:, None], block, 0)
        slot = np.where(within, self.slot[tuple(block.T)], -1).astype(np.int64)
        place = slot * _VOLUME + flat(inside, (SIDE, SIDE, SIDE))
        return np.asarray(np.where(slot < 0, -1, place))

    def voxels(self, places: Ints) -> Ints:
        """Return the (n, 3) voxels at places of a flat (blocks, 8, 8, 8) array."""
        inside = np.stack(np.unravel_index(places % _VOLUME, (SIDE, SIDE, SIDE)), axis=1)
        return np.asarray(self.index[places // _VOLUME] * SIDE + inside)

    def neighbour(self, axis: int, step: int) -> Ints:
        """Return the slot of the block ``step`` further along ``axis`` of each; -1 if none."""
        index = self.index.copy()
        index[:, axis] += step
        outside = (index[:, axis] < 0) | (index[:, axis] >= self.grid.shape[axis])
        index[outside] = 0
        return np.asarray(np.where(outside, -1, self.slot[tuple(index.T)]), dtype=np.int64)

    def axes(self) -> Iterator[Singles]:
        """Give the x, then y, then z coordinate in voxels of every voxel, to be broadcast."""
        for axis in range(3):
            inside = np.arange(SIDE, dtype=np.float32).reshape(np.roll((1, 1, SIDE), axis + 1))
            start = (self.index[:, axis] * SIDE).astype(np.float32)
            yield start[:, None, None, None] + inside[None]

    def blurred(self, values: Singles, kernel: Floats) -> Singles:
        """
        Convolve (blocks, 8, 8, 8) values, or (blocks, 8, 8, 8, n), with a symmetric kernel.

        What lies outside the blocks is 0. Along each axis it is a product with a band matrix,
        for few blocks at a time, so that what is padded stays in the processor's cache.
        """
        radius, shape = len(kernel) // 2, values.shape
        band = np.zeros((SIDE, SIDE + 2 * radius), dtype=np.float32)
        for k in range(SIDE):
            band[k, k : k + len(kernel)] = kernel
        depth = int(np.prod(shape[4:], dtype=np.int64))
        for axis in (2, 1, 0):
            values = values.reshape(-1, SIDE**axis, SIDE, SIDE ** (2 - axis) * depth)
            values = self._blurred_along(axis, values, band)
        return values.reshape(shape)

    def _blurred_along(self, axis: int, values: Singles, band: Singles) -> Singles:
        radius = (band.shape[1] - SIDE) // 2
        before, after = self.neighbour(axis, -1), self.neighbour(axis, 1)
        result = np.empty_like(values)
        count = max(1, _AT_ONCE // values[:1].size)
        _, first, _, last = values.shape
        padded = np.empty((count, first, band.shape[1], last), dtype=np.float32)
        for start in range(0, len(values), count):
            some = slice(start, start + count)
            part = padded[: len(values[some])]
            part[:, :, radius : radius + SIDE] = values[some]
            part[:, :, :radius] = _beside(values, before[some], slice(-radius, None))
            part[:, :, radius + SIDE :] = _beside(values, after[some], slice(None, radius))
            # many small products: for a large one BLAS would wake threads, and lose by it
            if last == 1:
                np.matmul(part[..., 0], band.T, out=result[some][..., 0])
            else:
                np.matmul(band, part, out=result[some])
        return result


def _beside(values: Singles, slots: Ints, layers: slice) -> Singles:
    """Return some layers of the blocks in ``slots``, 0 where there is none."""
    found = values[:, :, layers][slots]
    found[slots < 0] = 0.0
    return np.asarray(found)


def _fine(grid: Grid, size: int) -> tuple[int, int, int]:
    i, j, k = (side * SIDE // size for side in grid.shape)
    return i, j, k


def flat(index: Ints, shape: tuple[int, ...]) -> Ints:
    """Return the flat index of (n, 3) indices."""
    return np.asarray((index[:, 0] * shape[1] + index[:, 1]) * shape[2] + index[:, 2])
