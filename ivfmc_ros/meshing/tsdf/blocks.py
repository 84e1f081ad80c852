# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A grid of voxels of which only blocks near a surface exist."""

from collections.abc import Callable
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.meshing.parallel import in_parts
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Singles

_BITS = 3
SIDE = 1 << _BITS  # voxels along a block
VOLUME = SIDE**3
_AT_ONCE = 1 << 16  # voxels
# A grid of more blocks than this has voxels that are too small for what is in it.
_MOST_BLOCKS = 64_000_000
_ALL = slice(None)


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

    def voxels(self, points_xyz: Floats) -> NDArray[np.int32]:
        """Return the (n, 3) int32 voxels that points lie in."""
        voxels = np.empty(points_xyz.shape, dtype=np.int32)

        def fill(some: slice) -> None:
            voxels[some] = np.rint(self.coordinates(points_xyz[some]))

        in_parts(fill, len(points_xyz), _AT_ONCE)
        return voxels

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
    def near(cls, grid: Grid, voxels: NDArray[np.int32], radius: int) -> 'Blocks':
        """Return the blocks of all voxels that are within ``radius`` of (n, 3) voxels inside."""
        occupied = np.zeros(grid.shape, dtype=bool)

        def occupy(some: slice) -> None:
            occupied[tuple((voxels[some] >> _BITS).T)] = True

        in_parts(occupy, len(voxels), _AT_ONCE)
        own = cls(grid, np.flatnonzero(occupied))
        # of each block, towards which sides a voxel is near its rim
        sides = np.zeros((len(own), 3, 3, 3), dtype=bool)

        def look(some: slice) -> None:
            slot = own.slot[tuple((voxels[some] >> _BITS).T)]
            inside = voxels[some] & (SIDE - 1)
            side = 1 + (inside >= SIDE - radius) - (inside < radius).astype(np.int64)
            sides[slot, side[:, 0], side[:, 1], side[:, 2]] = True

        in_parts(look, len(voxels), _AT_ONCE)
        slot, *side = np.nonzero(sides)
        step = np.stack(side, axis=1) - 1
        for share in product((0, 1), repeat=3):
            occupied[tuple((own.index[slot] + step * share).T)] = True
        return cls(grid, np.flatnonzero(occupied))

    def joined(self, wanted: Bools) -> 'Blocks':
        """Return these blocks, in their slots, and after them those of a grid.shape mask."""
        new = np.flatnonzero(wanted & (self.slot < 0))
        ids = np.concatenate([flat(self.index, self.grid.shape), new])
        return Blocks(self.grid, ids)

    def place(self, voxels: NDArray[np.signedinteger]) -> Ints:
        """Return where (n, 3) voxels are in a flat (blocks, 8, 8, 8) array; -1 if nowhere."""
        places = np.empty(len(voxels), dtype=np.int64)
        slots, (sx, sy, sz) = self.slot.reshape(-1), self.grid.shape

        def look_up(some: slice) -> None:
            x, y, z = np.ascontiguousarray(voxels[some].T, dtype=np.int64)
            i, j, k = x >> _BITS, y >> _BITS, z >> _BITS
            within = (i >= 0) & (i < sx) & (j >= 0) & (j < sy) & (k >= 0) & (k < sz)
            slot = slots.take(np.where(within, (i * sy + j) * sz + k, 0)).astype(np.int64)
            low = SIDE - 1
            inside = ((x & low) << (2 * _BITS)) | ((y & low) << _BITS) | (z & low)
            places[some] = np.where(within & (slot >= 0), slot * VOLUME + inside, -1)

        in_parts(look_up, len(voxels), _AT_ONCE)
        return places

    def voxels(self, places: Ints) -> Ints:
        """Return the (n, 3) voxels at places of a flat (blocks, 8, 8, 8) array."""
        voxels = np.empty((len(places), 3), dtype=np.int64)
        x, y, z = inside_block(places)
        start = self.index[places // VOLUME] * SIDE
        for axis, inside in enumerate((x, y, z)):
            voxels[:, axis] = start[:, axis] + inside
        return voxels

    def neighbour(self, axis: int, step: int) -> Ints:
        """Return the slot of the block ``step`` further along ``axis`` of each; -1 if none."""
        index = self.index.copy()
        index[:, axis] += step
        outside = (index[:, axis] < 0) | (index[:, axis] >= self.grid.shape[axis])
        index[outside] = 0
        return np.asarray(np.where(outside, -1, self.slot[tuple(index.T)]), dtype=np.int64)

    def steps(self, step: int) -> Callable[[Ints, Ints], Ints]:
        """
        Return what finds the places one voxel further, or back, from (n,) places.

        It takes the places and along which axis each is to go; -1 is nowhere, and leads there.
        """
        beside = np.stack([self.neighbour(axis, step) for axis in range(3)])
        last = SIDE - 1 if step > 0 else 0

        def stepped(places: Ints, axis: Ints) -> Ints:
            bits = _BITS * (2 - axis)
            rim = (places >> bits) & (SIDE - 1) == last
            slot = beside[axis, places // VOLUME]
            over = slot * VOLUME + places % VOLUME - step * (SIDE - 1 << bits)
            nowhere = (places < 0) | (rim & (slot < 0))
            return np.where(nowhere, -1, np.where(rim, over, places + step * (1 << bits)))

        return stepped

    def axes(self, some: slice = _ALL) -> Iterator[Singles]:
        """Give the x, then y, then z coordinate in voxels of every voxel, to be broadcast."""
        for axis in range(3):
            inside = np.arange(SIDE, dtype=np.float32).reshape(np.roll((1, 1, SIDE), axis + 1))
            start = (self.index[some, axis] * SIDE).astype(np.float32)
            yield start[:, None, None, None] + inside[None]


def inside_block(places: Ints) -> tuple[Ints, Ints, Ints]:
    """Return where in its block each voxel is, along x, y, z."""
    low = SIDE - 1
    return (places >> (2 * _BITS)) & low, (places >> _BITS) & low, places & low


def flat(index: Ints, shape: tuple[int, ...]) -> Ints:
    """Return the flat index of (n, 3) indices."""
    return np.asarray((index[:, 0] * shape[1] + index[:, 1]) * shape[2] + index[:, 2])
