# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Sparse voxel grid: 8 x 8 x 8 blocks of voxels, of which only those near a surface exist.

Values on voxels are kept in (blocks, 8, 8, 8) arrays. A voxel is addressed either by its integer
coordinates (i, j, k) in the grid, or by its flat index into such an array; -1 is no voxel.
"""

from collections.abc import Callable
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.meshing.parallel import run_chunked
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Singles

_BITS = 3
BLOCK_SIDE = 1 << _BITS  # voxels along an edge of a block
BLOCK_VOXELS = BLOCK_SIDE**3
_CHUNK = 1 << 16  # voxels
# The dense table of blocks takes 4 bytes a block: 256 MB. A grid with more has a wrong voxel size.
_MAX_BLOCKS = 64_000_000
_ALL = slice(None)


@dataclass(frozen=True, eq=False, kw_only=True)
class VoxelGrid:
    """
    Position and size of a voxel grid. The center of voxel (i, j, k) is origin + voxel * (i, j, k).

    origin : (3,) float64, meters
    voxel : edge of a voxel, meters
    shape : number of blocks along x, y, z
    """

    origin: Floats
    voxel: float
    shape: tuple[int, int, int]

    @classmethod
    def around(cls, low: Floats, high: Floats, voxel: float, margin: int) -> 'VoxelGrid':
        """
        Return a grid that contains a box with a margin.

        low, high : (3,) meters, opposite corners of the box
        voxel : meters
        margin : voxels
        :raises ParameterError: the voxel is too small for the box
        """
        first = np.floor(low / voxel) - margin
        count = np.ceil((high / voxel - first + margin) / BLOCK_SIDE).astype(np.int64) + 1
        if float(np.prod(count.astype(np.float64))) > _MAX_BLOCKS:
            size = ' x '.join(f'{1e3 * side:.0f}' for side in high - low)
            raise ParameterError(
                f'voxel: {voxel * 1e3:.4g} mm is too small for a part of {size} mm; '
                'raise voxel or restrict the working volume'
            )
        i, j, k = count.tolist()
        return cls(origin=first * voxel, voxel=voxel, shape=(i, j, k))

    def to_voxels(self, points_xyz: Floats) -> Floats:
        """Return the real-valued voxel coordinates of (n, 3) points in meters."""
        return np.asarray((points_xyz - self.origin) / self.voxel)

    def nearest_voxels(self, points_xyz: Floats) -> NDArray[np.int32]:
        """Return the (n, 3) int32 voxels that contain points in meters."""
        voxels = np.empty(points_xyz.shape, dtype=np.int32)

        def compute(chunk: slice) -> None:
            voxels[chunk] = np.rint(self.to_voxels(points_xyz[chunk]))

        run_chunked(compute, len(points_xyz), _CHUNK)
        return voxels

    def to_points(self, coordinates: Floats) -> Floats:
        """Return the (n, 3) points in meters at real-valued voxel coordinates."""
        return np.asarray(self.origin + coordinates * self.voxel)


class VoxelBlocks:
    """
    The blocks of a grid that exist. The slot of a block is its place in (blocks, 8, 8, 8) arrays.

    grid : the grid
    index : (n, 3) int64, position of each block in the grid, in blocks
    slot : grid.shape int32, slot of the block at each position; -1 if it does not exist
    """

    def __init__(self, grid: VoxelGrid, ids: Ints) -> None:
        """``ids`` : (n,) flat indices into an array of grid.shape, in the order of the slots."""
        self.grid = grid
        self.index: Ints = np.stack(np.unravel_index(ids, grid.shape), axis=1).astype(np.int64)
        self.slot = np.full(grid.shape, -1, dtype=np.int32)
        self.slot.reshape(-1)[ids] = np.arange(len(ids), dtype=np.int32)

    def __len__(self) -> int:
        return len(self.index)

    @classmethod
    def near(cls, grid: VoxelGrid, voxels: NDArray[np.int32], radius: int) -> 'VoxelBlocks':
        """
        Return the blocks of all voxels within ``radius`` of given ones, in the order of the grid.

        voxels : (n, 3) int32, inside the grid
        radius : voxels along each axis, less than 8
        """
        occupied = np.zeros(grid.shape, dtype=bool)

        def occupy(chunk: slice) -> None:
            occupied[tuple((voxels[chunk] >> _BITS).T)] = True

        run_chunked(occupy, len(voxels), _CHUNK)
        own = cls(grid, np.flatnonzero(occupied))
        # of each block, to which of its 26 neighbors a voxel is near
        sides = np.zeros((len(own), 3, 3, 3), dtype=bool)

        def mark_sides(chunk: slice) -> None:
            slot = own.slot[tuple((voxels[chunk] >> _BITS).T)]
            local = voxels[chunk] & (BLOCK_SIDE - 1)
            side = 1 + (local >= BLOCK_SIDE - radius) - (local < radius).astype(np.int64)
            sides[slot, side[:, 0], side[:, 1], side[:, 2]] = True

        run_chunked(mark_sides, len(voxels), _CHUNK)
        slot, *side = np.nonzero(sides)
        step = np.stack(side, axis=1) - 1
        for mask in product((0, 1), repeat=3):
            occupied[tuple((own.index[slot] + step * mask).T)] = True
        return cls(grid, np.flatnonzero(occupied))

    def extended(self, mask: Bools) -> 'VoxelBlocks':
        """Return these blocks in their slots, followed by the new ones of a grid.shape mask."""
        new = np.flatnonzero(mask & (self.slot < 0))
        ids = np.concatenate([ravel_index(self.index, self.grid.shape), new])
        return VoxelBlocks(self.grid, ids)

    def flat_indices(self, voxels: NDArray[np.signedinteger]) -> Ints:
        """Return the (n,) int64 flat indices of (n, 3) voxels; -1 where no block exists."""
        indices = np.empty(len(voxels), dtype=np.int64)
        slots, (sx, sy, sz) = self.slot.reshape(-1), self.grid.shape

        def look_up(chunk: slice) -> None:
            x, y, z = np.ascontiguousarray(voxels[chunk].T, dtype=np.int64)
            i, j, k = x >> _BITS, y >> _BITS, z >> _BITS
            within = (i >= 0) & (i < sx) & (j >= 0) & (j < sy) & (k >= 0) & (k < sz)
            slot = slots.take(np.where(within, (i * sy + j) * sz + k, 0)).astype(np.int64)
            low = BLOCK_SIDE - 1
            local = ((x & low) << (2 * _BITS)) | ((y & low) << _BITS) | (z & low)
            indices[chunk] = np.where(within & (slot >= 0), slot * BLOCK_VOXELS + local, -1)

        run_chunked(look_up, len(voxels), _CHUNK)
        return indices

    def voxels(self, indices: Ints) -> Ints:
        """Return the (n, 3) int64 voxels at (n,) flat indices."""
        voxels = np.empty((len(indices), 3), dtype=np.int64)
        x, y, z = local_voxels(indices)
        start = self.index[indices // BLOCK_VOXELS] * BLOCK_SIDE
        for axis, local in enumerate((x, y, z)):
            voxels[:, axis] = start[:, axis] + local
        return voxels

    def neighbor_slots(self, axis: int, step: int) -> Ints:
        """Return (blocks,) slots of the blocks ``step`` blocks further along ``axis``, or -1."""
        index = self.index.copy()
        index[:, axis] += step
        outside = (index[:, axis] < 0) | (index[:, axis] >= self.grid.shape[axis])
        index[outside] = 0
        return np.asarray(np.where(outside, -1, self.slot[tuple(index.T)]), dtype=np.int64)

    def voxel_stepper(self, step: int) -> Callable[[Ints, Ints], Ints]:
        """
        Return a function that steps flat indices to the neighboring voxel.

        The function takes (n,) flat indices and the (n,) axes along which to step, and returns
        (n,) flat indices; -1 where no block exists, and for -1.

        step : 1 or -1
        """
        slots = np.stack([self.neighbor_slots(axis, step) for axis in range(3)])
        last = BLOCK_SIDE - 1 if step > 0 else 0

        def stepped(indices: Ints, axis: Ints) -> Ints:
            bits = _BITS * (2 - axis)
            leaves = (indices >> bits) & (BLOCK_SIDE - 1) == last
            slot = slots[axis, indices // BLOCK_VOXELS]
            over = slot * BLOCK_VOXELS + indices % BLOCK_VOXELS - step * (BLOCK_SIDE - 1 << bits)
            missing = (indices < 0) | (leaves & (slot < 0))
            return np.where(missing, -1, np.where(leaves, over, indices + step * (1 << bits)))

        return stepped

    def axis_coordinates(self, slots: slice = _ALL) -> Iterator[Singles]:
        """Yield the x, y and z voxel coordinates of blocks, broadcastable to their voxels."""
        for axis in range(3):
            shape = np.roll((1, 1, BLOCK_SIDE), axis + 1)
            local = np.arange(BLOCK_SIDE, dtype=np.float32).reshape(shape)
            start = (self.index[slots, axis] * BLOCK_SIDE).astype(np.float32)
            yield start[:, None, None, None] + local[None]


def local_voxels(indices: Ints) -> tuple[Ints, Ints, Ints]:
    """Return the x, y, z voxel coordinates of flat indices within their blocks, 0 to 7."""
    low = BLOCK_SIDE - 1
    return (indices >> (2 * _BITS)) & low, (indices >> _BITS) & low, indices & low


def ravel_index(index: Ints, shape: tuple[int, ...]) -> Ints:
    """Return the (n,) flat indices of (n, 3) indices into an array of ``shape``."""
    return np.asarray((index[:, 0] * shape[1] + index[:, 1]) * shape[2] + index[:, 2])
