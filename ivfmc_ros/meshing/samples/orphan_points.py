# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Points that their own view gives no normal: one from the faces around, or only word of them.

A stripe that falls on a wall in a single picture has no neighbours to the side. Where it lies in
the plane of samples that are farther away, and these face as that plane does, it is part of
their face.
"""

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from ivfmc_ros.meshing.samples.planes import Around
from ivfmc_ros.meshing.samples.planes import planes_at
from ivfmc_ros.meshing.samples.surface_samples import merge
from ivfmc_ros.meshing.samples.surface_samples import Samples
from ivfmc_ros.model import Floats

_NEIGHBOURS, _SCALE = 60, 2.0  # count; voxels
_EVERY = 3  # samples are denser than what was measured
_IN_PLANE = 2.5  # sigmas
_LEAST_SHARE, _LEAST_MEMBERS, _BROAD = 0.5, 5, 0.6
_LEAST_FACING = 0.15
# A normal from such points is worth less than one from a grid.
_WORTH = 0.3


def adopted(
    samples: Samples, cut_xyz: Floats, sigma: float, voxel: float, reach: float
) -> Samples:
    """
    Return the samples with those points without a normal that lie in a face of others.

    cut_xyz : (n, 3) metres, ends of stripes that do not go on as these do: given up if they do not
    sigma : metres, of a usual point
    reach : metres, up to which a face may be away
    """
    asked = np.concatenate([samples.alone_xyz, cut_xyz])
    if not len(asked) or not len(samples):
        return samples
    alone = samples.alone_xyz
    unknown = np.full(alone.shape, np.nan)
    around = Around(
        points_xyz=np.concatenate([samples.points_xyz[::_EVERY], alone]),
        normals=np.concatenate([samples.normals[::_EVERY], unknown]),
        count=_NEIGHBOURS,
        reach=reach,
        scale=_SCALE * voxel,
    )
    planes = planes_at(asked, around, _IN_PLANE * sigma, voxel, through=True)
    _, beside = cKDTree(samples.points_xyz).query(asked)
    facing = (planes.normals * samples.sight[beside]).sum(axis=1)
    good = (
        (planes.share > _LEAST_SHARE)
        & (planes.members > _LEAST_MEMBERS)
        & (planes.breadth > _BROAD * voxel)
        & (np.abs(planes.height) < _IN_PLANE * sigma)
        & (np.abs(facing) > _LEAST_FACING)
    )
    kept = np.arange(len(asked)) < len(samples.alone_xyz)
    chosen = beside[good]
    normals = planes.normals * np.copysign(1.0, facing)[:, None]
    new = Samples(
        points_xyz=asked[good],
        normals=normals[good],
        sight=samples.sight[chosen],
        weight=_WORTH * samples.weight[chosen],
        intensity=samples.intensity[chosen],
        alone_xyz=asked[kept & ~good],
    )
    return merge([replace(samples, alone_xyz=np.empty((0, 3))), new])
