# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Screened Poisson reconstruction (Kazhdan & Hoppe 2013) by Open3D, for comparison."""

import numpy as np

from ivfmc_ros.errors import GeometryError
from ivfmc_ros.meshing.geometry import normals
from ivfmc_ros.meshing.geometry import topology
from ivfmc_ros.meshing.samples.surface_samples import SurfaceSamples
from ivfmc_ros.meshing.settings import MeshSettings
from ivfmc_ros.model import FILLED
from ivfmc_ros.model import MEASURED
from ivfmc_ros.model import Mesh

_MIN_SAMPLES = 3
_SCALE = 1.1  # edge of the reconstruction cube, in extents of the points; Open3D's default
_MIN_DEPTH, _MAX_DEPTH = 4, 12  # of the octree


def poisson(
    samples: SurfaceSamples, voxel: float, max_edge: float, settings: MeshSettings
) -> Mesh:
    """
    Return the Poisson surface of all samples, with octree cells of about a voxel.

    Poisson reconstruction closes every hole. Triangles farther than half of ``max_edge`` from all
    samples are marked FILLED, and kept with ``close: all`` only. A few slivers (edges below 2
    micrometers, where cells of different size meet) intersect: 5 pairs of 109,000 triangles of a
    single view.

    voxel, max_edge : meters
    :raises GeometryError: there are no samples, or no triangle is near them
    """
    import open3d as o3d
    from scipy.spatial import cKDTree

    if len(samples) < _MIN_SAMPLES:
        raise GeometryError(
            'meshing: fewer than 3 points have neighbors on the surface; '
            'raise max_edge or scan in finer steps'
        )
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(samples.points_xyz))
    cloud.normals = o3d.utility.Vector3dVector(samples.normals)
    extent = float(np.ptp(samples.points_xyz, axis=0).max()) * _SCALE
    depth = int(np.clip(np.ceil(np.log2(max(extent / voxel, 2.0))), _MIN_DEPTH, _MAX_DEPTH))
    made, _ = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
        cloud, depth=depth, scale=_SCALE
    )
    vertices = np.asarray(made.vertices, dtype=np.float64)
    faces = np.asarray(made.triangles, dtype=np.int64)
    distance, nearest = cKDTree(samples.points_xyz).query(vertices, workers=-1)
    far = (distance > 0.5 * max_edge)[faces].any(axis=1)
    keep = np.ones(len(faces), dtype=bool) if settings.close == 'all' else ~far
    if not keep.any():
        raise GeometryError(
            f'meshing: Poisson has no triangle within {0.5e3 * max_edge:.3g} mm of the points; '
            'scan in finer steps or use method integrate'
        )
    used, kept = topology.compact_vertices(faces[keep], len(vertices))
    return Mesh(
        vertices_xyz=vertices[used],
        faces=kept,
        normals=normals.vertex_normals(vertices[used], kept),
        sigma=1.0 / np.sqrt(samples.weight[nearest[used]]),
        intensity=samples.intensity[nearest[used]],
        systematic=samples.systematic[nearest[used]],
        kind=np.where(far, FILLED, MEASURED).astype(np.uint8)[keep],
    )
