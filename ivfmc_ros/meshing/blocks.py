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
        Convolve (blocks, 8, 8, 8) values with a symmetric kernel along each axis.

        What lies outside the blocks is 0. One product of small matrices an axis: the fastest way
        that numpy has.
        """
        radius = len(kernel) // 2
        span = SIDE + 2 * radius
        band = np.zeros((SIDE, span), dtype=np.float32)
        for k in range(SIDE):
            band[k, k : k + len(kernel)] = kernel
        count, shape = len(values), values.shape
        for axis in (2, 1, 0):
            first, last = SIDE**axis, SIDE ** (2 - axis)
            values = values.reshape(count, first, SIDE, last)
            padded = np.zeros((count, first, span, last), dtype=np.float32)
            padded[:, :, radius : radius + SIDE] = values
            before, after = self.neighbour(axis, -1), self.neighbour(axis, 1)
            there = np.flatnonzero(before >= 0)
            padded[there, :, :radius] = values[before[there], :, -radius:]
            there = np.flatnonzero(after >= 0)
            padded[there, :, radius + SIDE :] = values[after[there], :, :radius]
            values = padded.reshape(-1, span) @ band.T if axis == 2 else band @ padded
        return values.reshape(shape)


def _fine(grid: Grid, size: int) -> tuple[int, int, int]:
    i, j, k = (side * SIDE // size for side in grid.shape)
    return i, j, k


def flat(index: Ints, shape: tuple[int, ...]) -> Ints:
    """Return the flat index of (n, 3) indices."""
    return np.asarray((index[:, 0] * shape[1] + index[:, 1]) * shape[2] + index[:, 2])
