# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Values in a few voxels, blurred over all voxels around: some blocks at a time."""

from itertools import product

import numpy as np

from ivfmc_ros.meshing.parallel import each_part
from ivfmc_ros.meshing.parallel import in_parts
from ivfmc_ros.meshing.tsdf.blocks import Blocks
from ivfmc_ros.meshing.tsdf.blocks import inside_block
from ivfmc_ros.meshing.tsdf.blocks import SIDE
from ivfmc_ros.meshing.tsdf.blocks import VOLUME
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Singles

RADIUS = 2  # voxels that a value reaches
AT_ONCE = 64  # blocks whose values stay in the processor's cache
_WIDE = SIDE + 2 * RADIUS


class Spread:
    """
    Which voxels are in and around each of ``blocks``, which are in the order of the grid.

    A block with the voxels around it makes 12 x 12 x 12 voxels. A voxel near the rim of its block
    is in those of other blocks too, and is found there without a search.
    """

    def __init__(self, blocks: Blocks, places: Ints) -> None:
        """``places`` : (n,) of different voxels in a flat (blocks, 8, 8, 8) array, ascending."""
        inside = inside_block(places)
        near = [(np.ones(len(at), dtype=bool), at >= SIDE - RADIUS, at < RADIUS) for at in inside]
        slot = places // VOLUME
        begin = np.arange(len(blocks) + 1) * _WIDE**3
        steps = list(product((-1, 0, 1), repeat=3))

        def listed(some: slice) -> tuple[Ints, Ints, Ints]:
            i, j, k = steps[some.start]
            row = np.flatnonzero(near[0][i] & near[1][j] & near[2][k])
            there = _neighbour(blocks, (i, j, k))[slot[row]]
            row, there = row[there >= 0], there[there >= 0]
            x, y, z = (
                at[row] - SIDE * step + RADIUS for at, step in zip(inside, (i, j, k), strict=True)
            )
            # ascending, as the blocks of one step have the order of the blocks that it is from
            where = ((there * _WIDE + x) * _WIDE + y) * _WIDE + z
            return row, where, np.searchsorted(where, begin)

        self._blocks = len(blocks)
        # for each step: rows of values, where they go, and with which of these a block begins
        self._lists = list(each_part(listed, len(steps), 1))

    def blurred(self, some: slice, values: Singles, kernel: Floats) -> Singles:
        """
        Convolve values with a symmetric kernel along each axis.

        some : blocks, from which to which
        values : (n, c), of each of the voxels; of all others they are 0
        kernel : of 1 to 5 voxels
        returns : (blocks, c, 8, 8, 8) float32
        """
        count = some.stop - some.start
        part = np.zeros((count * _WIDE**3, values.shape[1]), dtype=np.float32)
        for row, where, first in self._lists:
            chosen = slice(first[some.start], first[some.stop])
            part[where[chosen] - some.start * _WIDE**3] = values.take(row[chosen], axis=0)
        band = _band(kernel)
        # the axis that comes first is blurred and becomes the last, three times; BLAS is twice as
        # fast with the band this way round
        for _ in range(3):
            part = part.reshape(count, _WIDE, -1).transpose(0, 2, 1) @ band.T
        return part.reshape(count, values.shape[1], SIDE, SIDE, SIDE)

    def around(self, values: Singles, places: Ints) -> Singles:
        """Return (m, c) the sums of values over the 27 voxels around those at ``places``."""
        sums = np.zeros((len(places), values.shape[1]), dtype=np.float32)
        order = np.argsort(places, kind='stable')
        ordered = places[order]

        def add(some: slice) -> None:
            low, high = np.searchsorted(ordered, np.array([some.start, some.stop]) * VOLUME)
            if low < high:
                local = ordered[low:high] - some.start * VOLUME
                blurred = self.blurred(some, values, np.ones(3)).reshape(
                    -1, values.shape[1], VOLUME
                )
                sums[order[low:high]] = blurred[local // VOLUME, :, local % VOLUME]

        in_parts(add, self._blocks, AT_ONCE)
        return sums


def _neighbour(blocks: Blocks, step: tuple[int, ...]) -> Ints:
    """Return the slot of the block that is ``step`` from each; -1 if none."""
    index = blocks.index + np.array(step)
    within = ((index >= 0) & (index < blocks.grid.shape)).all(axis=1)
    slot = blocks.slot[tuple(np.where(within[:, None], index, 0).T)]
    return np.where(within, slot, -1).astype(np.int64)


def _band(kernel: Floats) -> Singles:
    """Return (8, 12): what the 8 in the middle of 12 voxels in a row get from each."""
    band = np.zeros((SIDE, _WIDE), dtype=np.float32)
    first = RADIUS - len(kernel) // 2
    for k in range(SIDE):
        band[k, first + k : first + k + len(kernel)] = kernel
    return band
