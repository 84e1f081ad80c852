# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Points that their own view gives no normal: one from all points around, or only word of them."""

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from ivfmc_ros.meshing.samples import merge
from ivfmc_ros.meshing.samples import Samples
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats

_REACH = 6.0  # voxels
_MOST, _LEAST = 13, 5  # points around
# The points around scatter this much about their plane, and the point itself lies off it.
_THICK, _OFF = 2.0, 6.0  # sigmas
# They are no line: their second extent, in voxels.
_BROAD = 0.6
_LEAST_FACING = 0.15
# A normal from such points is worth less than one from a grid.
_WORTH = 0.3


def adopted(samples: Samples, cut_xyz: Floats, sigma: float, voxel: float) -> Samples:
    """
    Return the samples with those points that lie in a plane with samples around them.

    Others stay alone; of the ends that an edge cut off they are given up.

    cut_xyz : (n, 3) metres, ends of stripes that do not go on as these do
    sigma : metres, of a usual point
    """
    asked = np.concatenate([samples.alone_xyz, cut_xyz])
    if not len(asked) or len(samples) < _LEAST:
        return samples
    normals, good = _planes(asked, samples, sigma, voxel)
    _, beside = cKDTree(samples.points_xyz).query(asked)
    facing = (normals * samples.sight[beside]).sum(axis=1)
    good &= np.abs(facing) > _LEAST_FACING
    normals *= np.copysign(1.0, facing)[:, None]
    kept = np.arange(len(asked)) < len(samples.alone_xyz)
    chosen = beside[good]
    new = Samples(
        points_xyz=asked[good],
        normals=normals[good],
        sight=samples.sight[chosen],
        weight=_WORTH * samples.weight[chosen],
        intensity=samples.intensity[chosen],
        alone_xyz=asked[kept & ~good],
    )
    return merge([replace(samples, alone_xyz=np.empty((0, 3))), new])


def _planes(asked: Floats, samples: Samples, sigma: float, voxel: float) -> tuple[Floats, Bools]:
    """Return (n, 3) normals of the points around, and whether these and the point make a plane."""
    known = np.concatenate([samples.points_xyz, samples.alone_xyz])
    distance, near = cKDTree(known).query(asked, k=_MOST, distance_upper_bound=_REACH * voxel)
    there = np.isfinite(distance)
    count = np.maximum(there.sum(axis=1), 1)[:, None]
    points = known[np.where(there, near, 0)]
    middle = (points * there[..., None]).sum(axis=1) / count
    offsets = (points - middle[:, None]) * there[..., None]
    scatter = np.einsum('nki,nkj->nij', offsets, offsets) / count[..., None]
    extents, axes = np.linalg.eigh(scatter)
    normals = axes[:, :, 0]
    off = np.abs(((asked - middle) * normals).sum(axis=1))
    good = (
        (there.sum(axis=1) >= _LEAST)
        & (extents[:, 1] > (_BROAD * voxel) ** 2)
        & (extents[:, 0] < (_THICK * sigma) ** 2)
        & (off < _OFF * sigma)
    )
    return normals, good
