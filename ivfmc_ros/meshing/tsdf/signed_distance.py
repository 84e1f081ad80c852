# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Signed distance of voxels to the surface samples around them, by accumulated plane distances.

Each sample is a plane n.(y - p) = 0. For a voxel center x two estimates are combined:

- the mean distance to the planes, weighted by 1/sigma^2 and by a Gaussian of the distance to the
  sample (Kolluri 2008). On a curved surface its zero lies outside, by half of the variance of the
  kernel times the curvature;
- the distance to the mean plane (Adamson & Alexa 2003). Its zero lies inside by the same amount.

A mean of both may have no bias of first order in the curvature, or one that makes up for what
follows: the vertices of surface nets, means of points on the surface, lie inside by a tenth of
the squared voxel times the curvature. Both need only sums over samples,
so that samples are accumulated in their voxels and the sums are blurred with the kernel: the cost
is linear in samples and voxels (as in Curless & Levoy 1996).
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from ivfmc_ros.meshing.parallel import run_chunked
from ivfmc_ros.meshing.samples.surface_samples import SurfaceSamples
from ivfmc_ros.meshing.tsdf.blocks import BLOCK_SIDE
from ivfmc_ros.meshing.tsdf.blocks import VoxelBlocks
from ivfmc_ros.meshing.tsdf.blocks import VoxelGrid
from ivfmc_ros.meshing.tsdf.blur import BLOCKS_PER_CHUNK
from ivfmc_ros.meshing.tsdf.blur import KERNEL_RADIUS
from ivfmc_ros.meshing.tsdf.blur import SparseBlur
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Singles

# Voxels with less accumulated weight (of the mean weight of a sample) have no distance.
_MIN_WEIGHT = 1e-6
KERNEL_SIGMA = 0.7  # voxels
KERNEL: Floats = np.exp(-0.5 * (np.arange(-KERNEL_RADIUS, KERNEL_RADIUS + 1) / KERNEL_SIGMA) ** 2)
KERNEL /= KERNEL.sum()
# Share of the mean distance to the planes: a half has no bias, more moves the zero outward. Found
# on spheres and cylinders of 8 to 32 voxels radius (test_signed_distance.py).
_MEAN_SHARE = np.float32(0.71)
_CHUNK = 1 << 16  # samples


@dataclass(frozen=True, eq=False, kw_only=True)
class SampleSums:
    """
    Sums over the samples in each voxel that contains some.

    blocks : all blocks within the kernel's radius of a sample or an orphan point
    blur : of values in these voxels, over ``blocks``
    indices : (n,) flat indices of these voxels, ascending
    planes : (n, 8) float32, sums of weight (1), weight * n.p (1), weight * n (3) and weight * p
        (3), with p in voxels and weights divided by ``mean_weight``
    counts : (n, 4) float32, number of samples, and sums of their intensities, of their weights
        divided by ``mean_weight``, and of these times the systematic sigma in meters
    orphans : (k,) flat indices of voxels that contain orphan points, ascending
    mean_weight : 1/meter^2, of all samples
    systematic_known : all samples have a systematic sigma
    """

    blocks: VoxelBlocks
    blur: SparseBlur
    indices: Ints
    planes: Singles
    counts: Singles
    orphans: Ints
    mean_weight: float
    systematic_known: bool


def accumulate(grid: VoxelGrid, samples: SurfaceSamples) -> SampleSums:
    """Sum the samples up in the voxels that contain them."""
    voxels = grid.nearest_voxels(np.concatenate([samples.points_xyz, samples.orphans_xyz]))
    blocks = VoxelBlocks.near(grid, voxels, KERNEL_RADIUS)
    indices = blocks.flat_indices(voxels)
    indices, orphans = indices[: len(samples)], indices[len(samples) :]
    order = np.argsort(indices, kind='stable')
    indices = indices[order]
    first = np.flatnonzero(np.diff(indices, prepend=-1))
    mean_weight = float(samples.weight.mean())
    # row v has a one for each sample in voxel v
    summing = csr_array(
        (np.ones(len(order), dtype=np.float32), order, np.append(first, len(order))),
        shape=(len(first), len(order)),
    )
    weight = samples.weight / mean_weight
    counts = np.stack(
        [
            np.ones(len(samples)),
            samples.intensity,
            weight,
            weight * np.nan_to_num(samples.systematic),
        ],
        axis=1,
    ).astype(np.float32)
    return SampleSums(
        blocks=blocks,
        blur=SparseBlur(blocks, indices[first]),
        indices=indices[first],
        planes=summing @ _plane_terms(grid, samples, mean_weight),
        counts=summing @ counts,
        orphans=np.unique(orphans),
        mean_weight=mean_weight,
        systematic_known=bool(np.isfinite(samples.systematic).all()),
    )


def _plane_terms(grid: VoxelGrid, samples: SurfaceSamples, mean_weight: float) -> Singles:
    """Return (n, 8), what each sample adds to ``SampleSums.planes``."""
    planes = np.empty((len(samples), 8), dtype=np.float32)

    def compute(chunk: slice) -> None:
        at = grid.to_voxels(samples.points_xyz[chunk])
        weight, normals = samples.weight[chunk, None] / mean_weight, samples.normals[chunk]
        planes[chunk, :1] = weight
        planes[chunk, 1:2] = weight * (normals * at).sum(axis=1, keepdims=True)
        planes[chunk, 2:5] = weight * normals
        planes[chunk, 5:] = weight * at

    run_chunked(compute, len(samples), _CHUNK)
    return planes


def signed_distance(sums: SampleSums, kernel: Floats = KERNEL) -> tuple[Singles, Singles]:
    """
    Evaluate the signed distance and the accumulated weight on all blocks.

    returns : (blocks, 8, 8, 8) float32 each: distance in voxels, positive outside, NaN where no
        sample is within the kernel; and weight, in units of ``sums.mean_weight``
    """
    blocks = sums.blocks
    shape = (len(blocks), BLOCK_SIDE, BLOCK_SIDE, BLOCK_SIDE)
    distances, weights = np.empty(shape, dtype=np.float32), np.empty(shape, dtype=np.float32)

    def compute(chunk: slice) -> None:
        weight, offset, *both = np.swapaxes(sums.blur.blur(chunk, sums.planes, kernel), 0, 1)
        mean, plane = -offset, np.zeros_like(offset)
        for normal, point, x in zip(
            both[:3], both[3:], blocks.axis_coordinates(chunk), strict=True
        ):
            mean += normal * x
            plane += normal * (weight * x - point)
        with np.errstate(invalid='ignore', divide='ignore'):
            known = np.where(weight > _MIN_WEIGHT, weight, np.float32(np.nan))
            combined = _MEAN_SHARE * mean + (np.float32(1.0) - _MEAN_SHARE) * plane / known
            distances[chunk] = combined / known
        weights[chunk] = weight

    run_chunked(compute, len(blocks), BLOCKS_PER_CHUNK)
    return distances, weights


def enclosing_grid(samples: SurfaceSamples, voxel: float, floor: float | None) -> VoxelGrid:
    """
    Return a grid around all samples and orphan points, down to below the floor.

    voxel : meters
    floor : meters, height of the platter; None for none
    :raises ParameterError: the voxel is too small for the samples
    """
    points = np.concatenate([samples.points_xyz, samples.orphans_xyz])
    low, high = points.min(axis=0), points.max(axis=0)
    if floor is not None:
        low[2] = min(low[2], floor)
    return VoxelGrid.around(low, high, voxel, 3 * BLOCK_SIDE)
