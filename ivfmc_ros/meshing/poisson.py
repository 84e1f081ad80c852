# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Screened Poisson reconstruction (Kazhdan & Hoppe 2013) by Open3D, to compare with."""

import numpy as np

from ivfmc_ros.errors import GeometryError
from ivfmc_ros.meshing.geometry import normals
from ivfmc_ros.meshing.geometry import topology
from ivfmc_ros.meshing.samples.surface_samples import Samples
from ivfmc_ros.meshing.settings import MeshSettings
from ivfmc_ros.model import FILLED
from ivfmc_ros.model import MEASURED
from ivfmc_ros.model import Mesh

_LEAST_SAMPLES = 3
_MARGIN = 1.1  # of the reconstruction's cube about the points
_MOST_DEPTH = 12


def poisson(samples: Samples, voxel: float, bridge: float, settings: MeshSettings) -> Mesh:
    """
    Return the Poisson surface of all samples, with cells of about a voxel.

    It closes every hole; triangles farther than half of ``bridge`` from the samples are marked,
    and kept with ``close: all`` only. A few of its slivers (edges below 2 micrometres, where
    cells of different size meet) intersect: 5 pairs of 109,000 triangles of a single view.

    :raises GeometryError: there are no samples, or no triangle is near them
    """
    import open3d as o3d
    from scipy.spatial import cKDTree

    if len(samples) < _LEAST_SAMPLES:
        raise GeometryError('meshing: no points with neighbours; raise max_edge')
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(samples.points_xyz))
    cloud.normals = o3d.utility.Vector3dVector(samples.normals)
    extent = float(np.ptp(samples.points_xyz, axis=0).max()) * _MARGIN
    depth = int(np.clip(np.ceil(np.log2(max(extent / voxel, 2.0))), 4, _MOST_DEPTH))
    made, _ = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
        cloud, depth=depth, scale=_MARGIN
    )
    vertices = np.asarray(made.vertices, dtype=np.float64)
    faces = np.asarray(made.triangles, dtype=np.int64)
    distance, nearest = cKDTree(samples.points_xyz).query(vertices, workers=-1)
    far = (distance > 0.5 * bridge)[faces].any(axis=1)
    keep = np.ones(len(faces), dtype=bool) if settings.close == 'all' else ~far
    if not keep.any():
        raise GeometryError(
            f'meshing: Poisson has no triangle within {0.5e3 * bridge:.3g} mm of the points; '
            'scan in finer steps or take method integrate'
        )
    used, kept = topology.compact(faces[keep], len(vertices))
    return Mesh(
        vertices_xyz=vertices[used],
        faces=kept,
        normals=normals.of_vertices(vertices[used], kept),
        sigma=1.0 / np.sqrt(samples.weight[nearest[used]]),
        intensity=samples.intensity[nearest[used]],
        kind=np.where(far, FILLED, MEASURED).astype(np.uint8)[keep],
    )
