# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Normals for orphan points from the faces around them.

An orphan point has no normal in its own view: a stripe that falls on a wall in a single profile
has no neighbors in other columns. Where orphan points lie in the plane of samples farther away,
and the normals of these samples agree with the plane, the points belong to the same face.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from ivfmc_ros.meshing.samples.planes import fit_planes
from ivfmc_ros.meshing.samples.planes import Neighborhood
from ivfmc_ros.meshing.samples.surface_samples import merge_samples
from ivfmc_ros.meshing.samples.surface_samples import SurfaceSamples
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints

_MAX_NEIGHBORS = 60
_DISTANCE_SIGMA = 2.0  # voxels, 1 sigma of the weight of a neighbor by its distance
_SAMPLE_STRIDE = 3  # interpolation makes samples denser than measured points
_INLIER_SIGMAS = 2.5
# Least share and number of inliers of a plane, and their least breadth in voxels.
_MIN_INLIER_RATIO, _MIN_INLIERS, _MIN_BREADTH = 0.5, 5, 0.6
_MIN_FACING = 0.15  # cosine between the normal and the direction to the camera
# Weight of an attached point relative to the nearest sample: its normal is less certain.
_WEIGHT = 0.3
# Systematic error of an attached point (1 sigma) in sigmas of a point, which is located to about a
# tenth of the sheet's thickness.
_SYSTEMATIC_SIGMAS = 5.0


def attach_orphan_points(
    samples: SurfaceSamples, dropped_xyz: Floats, sigma: float, voxel: float, radius: float
) -> SurfaceSamples:
    """
    Return the samples, and as further samples those orphan points that lie in a face of others.

    dropped_xyz : (n, 3) meters, truncated ends of stripes, which are attached likewise; those
        that lie in no face are dropped and do not stay orphan points
    sigma : meters, median 1 sigma of all points
    voxel : meters
    radius : meters, search radius for the face
    """
    queries = np.concatenate([samples.orphans_xyz, dropped_xyz])
    if not len(queries) or not len(samples):
        return samples
    orphans = samples.orphans_xyz
    unknown = np.full(orphans.shape, np.nan)
    neighborhood = Neighborhood(
        points_xyz=np.concatenate([samples.points_xyz[::_SAMPLE_STRIDE], orphans]),
        normals=np.concatenate([samples.normals[::_SAMPLE_STRIDE], unknown]),
        max_neighbors=_MAX_NEIGHBORS,
        radius=radius,
        distance_sigma=_DISTANCE_SIGMA * voxel,
    )
    tolerance = _INLIER_SIGMAS * sigma
    with ThreadPoolExecutor(1) as thread:
        # the search tree of all samples takes as long as the planes
        found = thread.submit(_nearest, samples.points_xyz, queries)
        planes = fit_planes(queries, neighborhood, tolerance, voxel, through_query=True)
    nearest = found.result()
    facing = (planes.normals * samples.to_camera[nearest]).sum(axis=1)
    good = (
        (planes.inlier_ratio > _MIN_INLIER_RATIO)
        & (planes.inliers > _MIN_INLIERS)
        & (planes.breadth > _MIN_BREADTH * voxel)
        & (np.abs(planes.height) < _INLIER_SIGMAS * sigma)
        & (np.abs(facing) > _MIN_FACING)
    )
    is_orphan = np.arange(len(queries)) < len(samples.orphans_xyz)
    chosen = nearest[good]
    normals = planes.normals * np.copysign(1.0, facing)[:, None]
    attached = SurfaceSamples(
        points_xyz=queries[good],
        normals=normals[good],
        to_camera=samples.to_camera[chosen],
        weight=_WEIGHT * samples.weight[chosen],
        intensity=samples.intensity[chosen],
        # a point without neighbors in its view is at the end of a stripe
        systematic=np.maximum(samples.systematic[chosen], _SYSTEMATIC_SIGMAS * sigma),
        orphans_xyz=queries[is_orphan & ~good],
    )
    return merge_samples([replace(samples, orphans_xyz=np.empty((0, 3))), attached])


def _nearest(points_xyz: Floats, queries: Floats) -> Ints:
    return np.asarray(cKDTree(points_xyz, balanced_tree=False).query(queries)[1])
