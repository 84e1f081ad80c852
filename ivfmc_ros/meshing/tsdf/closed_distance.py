# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Signed distance on all blocks that the closed surface passes through: measured, else coarse."""

import numpy as np
from scipy import ndimage

from ivfmc_ros.meshing.parallel import run_chunked
from ivfmc_ros.meshing.tsdf.blocks import BLOCK_SIDE
from ivfmc_ros.meshing.tsdf.blocks import VoxelBlocks
from ivfmc_ros.meshing.tsdf.hole_filling import CoarseDistance
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Singles

_MAX_ITERATIONS = 20  # of adding blocks until the surface is closed
_CHUNK = 256  # blocks
# Least absolute distance (voxels): a voxel exactly on the surface would have no sign.
_MIN_DISTANCE = 1e-4


def close_distance(
    blocks: VoxelBlocks, measured: Singles, coarse: CoarseDistance, floor: float | None
) -> tuple[VoxelBlocks, Singles]:
    """
    Return the blocks that the closed surface needs, and the signed distance on them.

    measured : (blocks, 8, 8, 8) float32, voxels, NaN where no sample is near
    coarse : the distance where ``measured`` is NaN
    floor : meters, height of the platter, below which there is nothing; None for none
    returns : blocks, the given ones first; and (blocks, 8, 8, 8) float32, voxels, no zeros
    """
    grid = blocks.grid
    level = None if floor is None else (floor - grid.origin[2]) / grid.voxel
    dense = _cut_at_floor(coarse.values, level, coarse.cell)
    blocks = blocks.extended(_crossed_blocks(dense, coarse.cell))
    values = _combined(blocks, 0, measured, coarse, level)
    for _ in range(_MAX_ITERATIONS):
        missing = _missing_blocks(blocks, values, dense, coarse.cell)
        if not missing.any():
            break
        blocks = blocks.extended(missing)
        more = _combined(blocks, len(values), measured, coarse, level)
        values = np.concatenate([values, more])
    return blocks, values


def _cut_at_floor(dense: Singles, level: float | None, cell: int) -> Singles:
    """Return the coarse distance with everything below ``level`` (voxels) outside."""
    if level is None:
        return dense
    height = np.arange(dense.shape[2], dtype=np.float32) * cell + 0.5 * (cell - 1)
    return np.asarray(np.maximum(dense, np.float32(level) - height))


def _crossed_blocks(dense: Singles, cell: int) -> Bools:
    """Return grid.shape bool, the blocks near the zero surface of the coarse distance."""
    outside = dense > 0
    mixed = ndimage.maximum_filter(outside, 3) & ~ndimage.minimum_filter(outside, 3)
    n = BLOCK_SIDE // cell
    i, j, k = (side // n for side in mixed.shape)
    return np.asarray(mixed.reshape(i, n, j, n, k, n).any(axis=(1, 3, 5)))


def _combined(
    blocks: VoxelBlocks,
    first: int,
    measured: Singles,
    coarse: CoarseDistance,
    level: float | None,
) -> Singles:
    """Return the distance on the blocks from slot ``first`` on: measured, else interpolated."""
    values = np.empty((len(blocks) - first, BLOCK_SIDE, BLOCK_SIDE, BLOCK_SIDE), dtype=np.float32)
    padded = np.pad(coarse.values, 1, mode='edge')

    def compute(chunk: slice) -> None:
        slots = slice(first + chunk.start, first + chunk.stop)
        distance = _upsampled(blocks.index[slots], padded, coarse.cell)
        known = measured[slots]
        np.copyto(distance[: len(known)], known, where=~np.isnan(known))
        if level is not None:
            *_, height = blocks.axis_coordinates(slots)
            distance = np.maximum(distance, np.float32(level) - height)
        least = np.copysign(np.float32(_MIN_DISTANCE), distance)
        values[chunk] = np.where(np.abs(distance) < _MIN_DISTANCE, least, distance)

    run_chunked(compute, len(values), _CHUNK)
    return values


def _upsampled(index: Ints, padded: Singles, cell: int) -> Singles:
    """Interpolate the padded coarse distance at every voxel of blocks, (blocks, 8, 8, 8)."""
    n = BLOCK_SIDE // cell
    support = np.arange(n + 2)
    x, y, z = (index[:, axis, None] * n + support for axis in range(3))
    values = padded[x[:, :, None, None], y[:, None, :, None], z[:, None, None, :]]
    at = (np.arange(BLOCK_SIDE) + 0.5) / cell + 0.5
    weights = np.maximum(0.0, 1.0 - np.abs(at[None] - support[:, None])).astype(np.float32)
    for _ in range(3):
        values = np.moveaxis(values @ weights, 3, 1)
    return np.ascontiguousarray(values)


def _missing_blocks(blocks: VoxelBlocks, values: Singles, dense: Singles, cell: int) -> Bools:
    """Return grid.shape bool, the blocks that do not exist though the surface enters them."""
    n = BLOCK_SIDE // cell
    missing = np.zeros(blocks.grid.shape, dtype=bool)
    outside = dense > 0
    for axis in range(3):
        for step in (-1, 1):
            border = np.flatnonzero(blocks.neighbor_slots(axis, step) < 0)
            beyond = blocks.index[border].copy()
            beyond[:, axis] += step
            inside = ((beyond >= 0) & (beyond < blocks.grid.shape)).all(axis=1)
            border, beyond = border[inside], beyond[inside]
            last = 0 if step < 0 else BLOCK_SIDE - 1
            layer = np.take(values[border] > 0, last, axis=axis + 1)
            # a missing block has one sign throughout, or the surface passes through it
            corner = tuple((beyond * n).T)
            sign = outside[corner]
            crossed = (layer != sign[:, None, None]).any(axis=(1, 2))
            missing[tuple(beyond[crossed].T)] = True
    return missing
