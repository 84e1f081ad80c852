# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Separable convolution of values in a few voxels, evaluated on all voxels of sparse blocks."""

from itertools import product

import numpy as np

from ivfmc_ros.meshing.parallel import map_chunked
from ivfmc_ros.meshing.parallel import run_chunked
from ivfmc_ros.meshing.tsdf.blocks import BLOCK_SIDE
from ivfmc_ros.meshing.tsdf.blocks import BLOCK_VOXELS
from ivfmc_ros.meshing.tsdf.blocks import local_voxels
from ivfmc_ros.meshing.tsdf.blocks import VoxelBlocks
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Singles

KERNEL_RADIUS = 2  # voxels
BLOCKS_PER_CHUNK = 64  # the values of so many blocks stay in the processor's cache
_PADDED = BLOCK_SIDE + 2 * KERNEL_RADIUS


class SparseBlur:
    """
    Convolution of values that are given in some voxels only, and zero in all others.

    Each block is padded with the voxels around it to 12 x 12 x 12 voxels. The constructor lists
    once which values go where in which padded block; a voxel near the border of its block is in
    the padding of other blocks too.
    """

    def __init__(self, blocks: VoxelBlocks, indices: Ints) -> None:
        """
        Prepare the convolution of values in given voxels.

        blocks : in the order of the grid
        indices : (n,) flat indices of different voxels, ascending
        """
        local = local_voxels(indices)
        near = [
            (np.ones(len(at), dtype=bool), at >= BLOCK_SIDE - KERNEL_RADIUS, at < KERNEL_RADIUS)
            for at in local
        ]
        slot = indices // BLOCK_VOXELS
        begin = np.arange(len(blocks) + 1) * _PADDED**3
        steps = list(product((-1, 0, 1), repeat=3))

        def listed(chunk: slice) -> tuple[Ints, Ints, Ints]:
            i, j, k = steps[chunk.start]
            row = np.flatnonzero(near[0][i] & near[1][j] & near[2][k])
            target = _neighbor_slots(blocks, (i, j, k))[slot[row]]
            row, target = row[target >= 0], target[target >= 0]
            x, y, z = (
                at[row] - BLOCK_SIDE * step + KERNEL_RADIUS
                for at, step in zip(local, (i, j, k), strict=True)
            )
            # ascending, because the target blocks of one step have the order of their origins
            padded = ((target * _PADDED + x) * _PADDED + y) * _PADDED + z
            return row, padded, np.searchsorted(padded, begin)

        self._blocks = len(blocks)
        # for each step: rows of values, their flat indices in the padded blocks, and the first
        # of these of each block
        self._lists = list(map_chunked(listed, len(steps), 1))

    def blur(self, slots: slice, values: Singles, kernel: Floats) -> Singles:
        """
        Convolve values with a symmetric kernel along each axis.

        slots : blocks on which to evaluate, with start and stop
        values : (n, c) float32, of the voxels given to the constructor
        kernel : (1,) to (5,), of an odd number of voxels
        returns : (blocks, c, 8, 8, 8) float32
        """
        count = slots.stop - slots.start
        padded = np.zeros((count * _PADDED**3, values.shape[1]), dtype=np.float32)
        for row, where, first in self._lists:
            chosen = slice(first[slots.start], first[slots.stop])
            padded[where[chosen] - slots.start * _PADDED**3] = values.take(row[chosen], axis=0)
        band = _band_matrix(kernel)
        # the first axis is blurred and becomes the last, three times; BLAS is twice as fast with
        # the band on this side
        for _ in range(3):
            padded = padded.reshape(count, _PADDED, -1).transpose(0, 2, 1) @ band.T
        return padded.reshape(count, values.shape[1], BLOCK_SIDE, BLOCK_SIDE, BLOCK_SIDE)

    def sum_neighborhoods(self, values: Singles, indices: Ints) -> Singles:
        """
        Sum values over the 3 x 3 x 3 voxels around given ones.

        values : (n, c) float32, of the voxels given to the constructor
        indices : (m,) flat indices; 0 is returned for indices outside of the blocks
        returns : (m, c) float32
        """
        sums = np.zeros((len(indices), values.shape[1]), dtype=np.float32)
        order = np.argsort(indices, kind='stable')
        ordered = indices[order]

        def add(chunk: slice) -> None:
            limits = np.array([chunk.start, chunk.stop]) * BLOCK_VOXELS
            low, high = np.searchsorted(ordered, limits)
            if low < high:
                local = ordered[low:high] - chunk.start * BLOCK_VOXELS
                blurred = self.blur(chunk, values, np.ones(3)).reshape(
                    -1, values.shape[1], BLOCK_VOXELS
                )
                sums[order[low:high]] = blurred[local // BLOCK_VOXELS, :, local % BLOCK_VOXELS]

        run_chunked(add, self._blocks, BLOCKS_PER_CHUNK)
        return sums


def _neighbor_slots(blocks: VoxelBlocks, step: tuple[int, ...]) -> Ints:
    """Return the slot of the block that is ``step`` blocks from each; -1 if it does not exist."""
    index = blocks.index + np.array(step)
    within = ((index >= 0) & (index < blocks.grid.shape)).all(axis=1)
    slot = blocks.slot[tuple(np.where(within[:, None], index, 0).T)]
    return np.where(within, slot, -1).astype(np.int64)


def _band_matrix(kernel: Floats) -> Singles:
    """Return the (8, 12) matrix that convolves 12 voxels in a row to the 8 in their middle."""
    band = np.zeros((BLOCK_SIDE, _PADDED), dtype=np.float32)
    first = KERNEL_RADIUS - len(kernel) // 2
    for k in range(BLOCK_SIDE):
        band[k, first + k : first + k + len(kernel)] = kernel
    return band
