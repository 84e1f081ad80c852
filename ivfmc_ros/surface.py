# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Nearest points, signed distances and ray casting on a triangle mesh (Embree, by Open3D)."""

from dataclasses import dataclass

import numpy as np
import open3d as o3d

from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints


@dataclass(frozen=True, eq=False)
class Nearest:
    """
    Nearest point of a surface to each of n query points.

    points_xyz : (n, 3) float64, meters
    normals : (n, 3) float64, unit normals of the faces that contain the points
    faces : (n,) int64, indices of these faces
    distance : (n,) float64, meters, not negative
    """

    points_xyz: Floats
    normals: Floats
    faces: Ints
    distance: Floats


@dataclass(frozen=True, eq=False)
class Hits:
    """
    First intersection of each of n rays with a surface.

    distance : (n,) float64, in lengths of the ray's direction; inf where there is none
    normals : (n, 3) float64, unit normals of the faces that are hit
    faces : (n,) int64, indices of these faces; -1 where there is none
    weights : (n, 3) float64, barycentric weights of the corners of these faces
    """

    distance: Floats
    normals: Floats
    faces: Ints
    weights: Floats


class Surface:
    """
    A triangle mesh with an index for queries, which are computed in single precision.

    vertices_xyz : (n, 3) meters; faces : (m, 3) vertex indices
    """

    def __init__(self, vertices_xyz: Floats, faces: Ints) -> None:
        self._scene = o3d.t.geometry.RaycastingScene()
        self._scene.add_triangles(
            o3d.core.Tensor.from_numpy(np.ascontiguousarray(vertices_xyz, dtype=np.float32)),
            o3d.core.Tensor.from_numpy(np.ascontiguousarray(faces, dtype=np.uint32)),
        )

    def nearest(self, points_xyz: Floats) -> Nearest:
        """Return the nearest point of the surface to each of (n, 3) finite points."""
        found = self._scene.compute_closest_points(_single(points_xyz))
        nearest = found['points'].numpy().astype(np.float64)
        return Nearest(
            points_xyz=nearest,
            normals=found['primitive_normals'].numpy().astype(np.float64),
            faces=found['primitive_ids'].numpy().astype(np.int64),
            distance=np.linalg.norm(nearest - points_xyz, axis=1),
        )

    def signed_distance(self, points_xyz: Floats) -> Floats:
        """Return (n,) meters, distance of (n, 3) points from a closed surface, negative inside."""
        return np.asarray(
            self._scene.compute_signed_distance(_single(points_xyz)).numpy(), dtype=np.float64
        )

    def cast(self, origins: Floats, directions: Floats) -> Hits:
        """Cast rays from (n, 3) or (3,) origins along (n, 3) or (3,) directions."""
        rays = np.concatenate(np.broadcast_arrays(origins, directions), axis=1)
        found = self._scene.cast_rays(_single(rays))
        distance = found['t_hit'].numpy().astype(np.float64)
        u, v = found['primitive_uvs'].numpy().astype(np.float64).T
        faces = found['primitive_ids'].numpy().astype(np.int64)
        return Hits(
            distance=distance,
            normals=found['primitive_normals'].numpy().astype(np.float64),
            faces=np.where(np.isfinite(distance), faces, -1),
            weights=np.stack([1.0 - u - v, u, v], axis=1),
        )


def _single(values: Floats) -> o3d.core.Tensor:
    return o3d.core.Tensor.from_numpy(np.ascontiguousarray(values, dtype=np.float32))
