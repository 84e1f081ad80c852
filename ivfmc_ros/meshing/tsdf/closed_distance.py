# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A signed distance on all blocks that the closed surface passes through."""

import numpy as np
from scipy import ndimage

from ivfmc_ros.meshing.parallel import in_parts
from ivfmc_ros.meshing.tsdf.blocks import Blocks
from ivfmc_ros.meshing.tsdf.blocks import SIDE
from ivfmc_ros.meshing.tsdf.hole_filling import Coarse
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Singles

_ROUNDS = 20
_AT_ONCE = 256  # blocks
# A voxel that is exactly on the surface would belong to no side.
_LEAST = 1e-4


def whole_distance(
    blocks: Blocks, measured: Singles, coarse: Coarse, floor: float | None
) -> tuple[Blocks, Singles]:
    """
    Return the blocks that a closed surface needs, and the distance in voxels on them.

    measured : (blocks, 8, 8, 8), NaN where no sample is near; there ``coarse`` decides
    floor : height of the plane that the part stands on, metres; nothing of it is below
    """
    grid = blocks.grid
    level = None if floor is None else (floor - grid.origin[2]) / grid.voxel
    dense = _cut(coarse.values, level, coarse.cell)
    blocks = blocks.joined(_crossed(dense, coarse.cell))
    values = _values(blocks, 0, measured, coarse, level)
    for _ in range(_ROUNDS):
        missing = _missing(blocks, values, dense, coarse.cell)
        if not missing.any():
            break
        blocks = blocks.joined(missing)
        more = _values(blocks, len(values), measured, coarse, level)
        values = np.concatenate([values, more])
    return blocks, values


def _cut(dense: Singles, level: float | None, cell: int) -> Singles:
    if level is None:
        return dense
    height = np.arange(dense.shape[2], dtype=np.float32) * cell + 0.5 * (cell - 1)
    return np.asarray(np.maximum(dense, np.float32(level) - height))


def _crossed(dense: Singles, cell: int) -> Bools:
    """Return which blocks of the grid the surface of the coarse distance comes near."""
    outside = dense > 0
    mixed = ndimage.maximum_filter(outside, 3) & ~ndimage.minimum_filter(outside, 3)
    n = SIDE // cell
    i, j, k = (side // n for side in mixed.shape)
    return np.asarray(mixed.reshape(i, n, j, n, k, n).any(axis=(1, 3, 5)))


def _values(
    blocks: Blocks, first: int, measured: Singles, coarse: Coarse, level: float | None
) -> Singles:
    """Return the distance on the blocks from slot ``first`` on."""
    values = np.empty((len(blocks) - first, SIDE, SIDE, SIDE), dtype=np.float32)
    padded = np.pad(coarse.values, 1, mode='edge')

    def compute(some: slice) -> None:
        slots = slice(first + some.start, first + some.stop)
        part = _upsampled(blocks.index[slots], padded, coarse.cell)
        known = measured[slots]
        np.copyto(part[: len(known)], known, where=~np.isnan(known))
        if level is not None:
            *_, height = blocks.axes(slots)
            part = np.maximum(part, np.float32(level) - height)
        least = np.copysign(np.float32(_LEAST), part)
        values[some] = np.where(np.abs(part) < _LEAST, least, part)

    in_parts(compute, len(values), _AT_ONCE)
    return values


def _upsampled(index: Ints, padded: Singles, cell: int) -> Singles:
    """Interpolate the padded coarse distance at every voxel of blocks, (blocks, 8, 8, 8)."""
    n = SIDE // cell
    reach = np.arange(n + 2)
    x, y, z = (index[:, axis, None] * n + reach for axis in range(3))
    values = padded[x[:, :, None, None], y[:, None, :, None], z[:, None, None, :]]
    at = (np.arange(SIDE) + 0.5) / cell + 0.5
    weights = np.maximum(0.0, 1.0 - np.abs(at[None] - reach[:, None])).astype(np.float32)
    for _ in range(3):
        values = np.moveaxis(values @ weights, 3, 1)
    return np.ascontiguousarray(values)


def _missing(blocks: Blocks, values: Singles, dense: Singles, cell: int) -> Bools:
    """Return which blocks do not exist though the surface passes into them."""
    n = SIDE // cell
    missing = np.zeros(blocks.grid.shape, dtype=bool)
    outside = dense > 0
    for axis in range(3):
        for step in (-1, 1):
            open_end = np.flatnonzero(blocks.neighbour(axis, step) < 0)
            there = blocks.index[open_end].copy()
            there[:, axis] += step
            inside = ((there >= 0) & (there < blocks.grid.shape)).all(axis=1)
            open_end, there = open_end[inside], there[inside]
            layer = np.take(values[open_end] > 0, 0 if step < 0 else SIDE - 1, axis=axis + 1)
            # the block that is missing is all of one sign, or the surface is in it
            corner = tuple((there * n).T)
            sign = outside[corner]
            crossed = (layer != sign[:, None, None]).any(axis=(1, 2))
            missing[tuple(there[crossed].T)] = True
    return missing
