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

from ivfmc_ros.meshing.blocks import Blocks
from ivfmc_ros.meshing.blocks import Grid
from ivfmc_ros.meshing.blocks import SIDE
from ivfmc_ros.meshing.samples import Samples
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Singles

RADIUS = 2  # voxels that a sample reaches
_LEAST_WEIGHT = 1e-6  # of the mean sample's
SPREAD = 0.7  # voxels, 1 sigma of its kernel
KERNEL: Floats = np.exp(-0.5 * (np.arange(-RADIUS, RADIUS + 1) / SPREAD) ** 2)
KERNEL /= KERNEL.sum()


@dataclass(frozen=True, eq=False, kw_only=True)
class Sums:
    """
    Sums over the samples in each voxel, (blocks, 8, 8, 8) float32.

    weight : of the samples, divided by ``scale``, their mean in 1/metre^2
    normals, points : three each, of weight * n and weight * p, with p in voxels
    offset : of weight * n.p
    counts : of samples; light : of their intensity
    points_seen : of all points, those without a normal too
    """

    weight: Singles
    normals: tuple[Singles, Singles, Singles]
    points: tuple[Singles, Singles, Singles]
    offset: Singles
    counts: Singles
    light: Singles
    points_seen: Singles
    scale: float


def sum_up(blocks: Blocks, samples: Samples) -> Sums:
    """Sum the samples up, each in the voxel that it lies in."""
    at = blocks.grid.coordinates(samples.points_xyz)
    place = blocks.place(np.rint(at).astype(np.int64))
    scale = float(samples.weight.mean())
    weight = samples.weight / scale

    order = np.argsort(place, kind='stable')
    place = place[order]
    first = np.flatnonzero(np.diff(place, prepend=-1))

    def total(values: Floats) -> Singles:
        sums = np.zeros((len(blocks), SIDE, SIDE, SIDE), dtype=np.float32)
        sums.reshape(-1)[place[first]] = np.add.reduceat(values[order], first)
        return sums

    nx, ny, nz = (total(weight * samples.normals[:, k]) for k in range(3))
    x, y, z = (total(weight * at[:, k]) for k in range(3))
    counts = total(np.ones(len(samples)))
    return Sums(
        weight=total(weight),
        normals=(nx, ny, nz),
        points=(x, y, z),
        offset=total(weight * (samples.normals * at).sum(axis=1)),
        counts=counts,
        light=total(samples.intensity),
        points_seen=_with_alone(blocks, counts, samples),
        scale=scale,
    )


def _with_alone(blocks: Blocks, counts: Singles, samples: Samples) -> Singles:
    if not len(samples.alone_xyz):
        return counts
    at = blocks.grid.coordinates(samples.alone_xyz)
    place = blocks.place(np.rint(at).astype(np.int64))
    more = np.bincount(place[place >= 0], minlength=counts.size)
    return (counts + more.reshape(counts.shape)).astype(np.float32)


def distance(blocks: Blocks, sums: Sums, kernel: Floats = KERNEL) -> tuple[Singles, Singles]:
    """
    Return the signed distance in voxels, outside positive, NaN out of reach; and the weight.

    Both are (blocks, 8, 8, 8).
    """
    weight, offset = _blurred(blocks, kernel, sums.weight, sums.offset)
    mean = -offset
    plane = np.zeros_like(mean)
    for normals, points, x in zip(sums.normals, sums.points, blocks.axes(), strict=True):
        normal, point = _blurred(blocks, kernel, normals, points)
        mean += normal * x
        plane += normal * (weight * x - point)
    with np.errstate(invalid='ignore', divide='ignore'):
        known = np.where(weight > _LEAST_WEIGHT, weight, np.float32(np.nan))
        distance = np.float32(0.5) * (mean + plane / known) / known
    return distance.astype(np.float32), weight


def _blurred(
    blocks: Blocks, kernel: Floats, first: Singles, second: Singles
) -> tuple[Singles, Singles]:
    """Blur two at once, which takes less time."""
    both = blocks.blurred(np.stack([first, second], axis=-1), kernel)
    return np.ascontiguousarray(both[..., 0]), np.ascontiguousarray(both[..., 1])


def grid_of(samples: Samples, voxel: float, floor: float | None) -> Grid:
    """Return a grid around the samples and down to below the floor."""
    points = np.concatenate([samples.points_xyz, samples.alone_xyz])
    low, high = points.min(axis=0), points.max(axis=0)
    if floor is not None:
        low[2] = min(low[2], floor)
    return Grid.around(low, high, voxel, 3 * SIDE)
