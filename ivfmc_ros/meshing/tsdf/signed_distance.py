# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A signed distance on voxels, from all samples at once.

Around x the samples are planes n.(y - p) = 0. The mean of their distances, weighted by 1/sigma^2
and by how near they are (Kolluri 2008), lies outside of a curved surface by half of the kernel's
variance times the curvature; the distance to the mean plane (Adamson & Alexa 2003) lies inside by
as much. Half of both lies on it. All is made of a few sums over samples, so that a sample goes
into one voxel and a blur of the sums does the rest: the time is that of the samples plus that of
the voxels (as in Curless & Levoy 1996).
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from ivfmc_ros.meshing.parallel import in_parts
from ivfmc_ros.meshing.samples.surface_samples import Samples
from ivfmc_ros.meshing.tsdf.blocks import Blocks
from ivfmc_ros.meshing.tsdf.blocks import Grid
from ivfmc_ros.meshing.tsdf.blocks import SIDE
from ivfmc_ros.meshing.tsdf.blur import AT_ONCE
from ivfmc_ros.meshing.tsdf.blur import RADIUS
from ivfmc_ros.meshing.tsdf.blur import Spread
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Singles

_LEAST_WEIGHT = 1e-6  # of the mean sample's
SPREAD = 0.7  # voxels, 1 sigma of its kernel
KERNEL: Floats = np.exp(-0.5 * (np.arange(-RADIUS, RADIUS + 1) / SPREAD) ** 2)
KERNEL /= KERNEL.sum()
_SAMPLES_AT_ONCE = 1 << 16


@dataclass(frozen=True, eq=False, kw_only=True)
class Sums:
    """
    Sums over the samples in each voxel that has some.

    spread : of these voxels, over the blocks around
    places : (n,) of these voxels in a flat (blocks, 8, 8, 8) array, ascending
    planes : (n, 8) float32: of weight, of weight * n.p, of weight * n, of weight * p, with p in
        voxels and weights divided by ``scale``, their mean in 1/metre^2
    seen : (n, 2) float32: how many samples, and the sum of their intensity
    alone : (k,) places of voxels with points without a normal, ascending
    """

    blocks: Blocks
    spread: Spread
    places: Ints
    planes: Singles
    seen: Singles
    alone: Ints
    scale: float


def sum_up(grid: Grid, samples: Samples) -> Sums:
    """Sum the samples up, each in the voxel that it lies in."""
    voxels = grid.voxels(np.concatenate([samples.points_xyz, samples.alone_xyz]))
    blocks = Blocks.near(grid, voxels, RADIUS)
    places = blocks.place(voxels)
    places, alone = places[: len(samples)], places[len(samples) :]
    order = np.argsort(places, kind='stable')
    places = places[order]
    first = np.flatnonzero(np.diff(places, prepend=-1))
    scale = float(samples.weight.mean())
    # row v has a one for each sample in voxel v
    adding = csr_array(
        (np.ones(len(order), dtype=np.float32), order, np.append(first, len(order))),
        shape=(len(first), len(order)),
    )
    seen = np.stack([np.ones(len(samples)), samples.intensity], axis=1).astype(np.float32)
    return Sums(
        blocks=blocks,
        spread=Spread(blocks, places[first]),
        places=places[first],
        planes=adding @ _planes(grid, samples, scale),
        seen=adding @ seen,
        alone=np.unique(alone),
        scale=scale,
    )


def _planes(grid: Grid, samples: Samples, scale: float) -> Singles:
    planes = np.empty((len(samples), 8), dtype=np.float32)

    def compute(some: slice) -> None:
        at = grid.coordinates(samples.points_xyz[some])
        weight, normals = samples.weight[some, None] / scale, samples.normals[some]
        planes[some, :1] = weight
        planes[some, 1:2] = weight * (normals * at).sum(axis=1, keepdims=True)
        planes[some, 2:5] = weight * normals
        planes[some, 5:] = weight * at

    in_parts(compute, len(samples), _SAMPLES_AT_ONCE)
    return planes


def distance(sums: Sums, kernel: Floats = KERNEL) -> tuple[Singles, Singles]:
    """
    Return the signed distance in voxels, outside positive, NaN out of reach; and the weight.

    Both are (blocks, 8, 8, 8).
    """
    blocks = sums.blocks
    shape = (len(blocks), SIDE, SIDE, SIDE)
    distances, weights = np.empty(shape, dtype=np.float32), np.empty(shape, dtype=np.float32)

    def measure(some: slice) -> None:
        weight, offset, *both = np.swapaxes(sums.spread.blurred(some, sums.planes, kernel), 0, 1)
        mean, plane = -offset, np.zeros_like(offset)
        for normal, point, x in zip(both[:3], both[3:], blocks.axes(some), strict=True):
            mean += normal * x
            plane += normal * (weight * x - point)
        with np.errstate(invalid='ignore', divide='ignore'):
            known = np.where(weight > _LEAST_WEIGHT, weight, np.float32(np.nan))
            distances[some] = np.float32(0.5) * (mean + plane / known) / known
        weights[some] = weight

    in_parts(measure, len(blocks), AT_ONCE)
    return distances, weights


def grid_of(samples: Samples, voxel: float, floor: float | None) -> Grid:
    """Return a grid around the samples and down to below the floor."""
    points = np.concatenate([samples.points_xyz, samples.alone_xyz])
    low, high = points.min(axis=0), points.max(axis=0)
    if floor is not None:
        low[2] = min(low[2], floor)
    return Grid.around(low, high, voxel, 3 * SIDE)
