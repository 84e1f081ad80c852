# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Triangles of part and platter for ray casting (open3d), in the frame ``turntable``."""

from typing import Any

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.simulation.parts.loading import Platter
from ivfmc_ros.simulation.parts.loading import Solid

NO_FACE = -1  # index of the face of a ray without an intersection

_DISC_EDGES = 360
# meters along the normal, so that a shadow ray does not meet the face that it starts on
_SHADOW_RAY_OFFSET = 1e-5


class Scene:
    """
    Triangle mesh with a ray caster.

    vertices_xyz : (n, 3) meters
    faces : (m, 3) int64, of the part first, then of the platter
    normals : (m, 3) outward unit normals
    reflectance : (m,) 1 is white
    part_faces : number of faces of the part
    """

    def __init__(self, solid: Solid | None, platter: Platter | None, reflectance: float) -> None:
        bodies = [(body, albedo) for body, albedo in _bodies(solid, platter, reflectance)]
        counts = np.cumsum([0, *(len(body.vertices_xyz) for body, _ in bodies)])
        self.vertices_xyz: Floats = np.concatenate(
            [np.empty((0, 3)), *(body.vertices_xyz for body, _ in bodies)]
        )
        self.faces: Ints = np.concatenate(
            [
                np.empty((0, 3), dtype=np.int64),
                *(body.faces + first for (body, _), first in zip(bodies, counts, strict=False)),
            ]
        )
        self.normals: Floats = np.concatenate(
            [np.empty((0, 3)), *(body.normals for body, _ in bodies)]
        )
        self.reflectance: Floats = np.repeat(
            [albedo for _, albedo in bodies], [len(body.faces) for body, _ in bodies]
        )
        self.part_faces = len(solid.faces) if solid is not None else 0
        self._rays = _raycaster(self.vertices_xyz, self.faces)

    def cast(self, origin: Floats, directions: Floats) -> tuple[Floats, Ints]:
        """
        Return the first intersection of each ray.

        origin : (3,) meters
        directions : (n, 3), of any length
        returns : (n,) distance in units of the direction, infinite without an intersection;
            (n,) index of the face, or NO_FACE
        """
        if not len(self.faces):
            return np.full(len(directions), np.inf), np.full(len(directions), NO_FACE)
        hits = self._rays.cast_rays(
            _ray_tensor(np.broadcast_to(origin, directions.shape), directions)
        )
        face = hits['primitive_ids'].numpy().astype(np.int64)
        met = np.isfinite(hits['t_hit'].numpy())
        face[~met] = NO_FACE
        # open3d casts in single precision: the face is kept, the distance is recomputed
        with np.errstate(divide='ignore', invalid='ignore'):
            lengths = self.plane_lengths(face, origin, directions)
        return np.where(met, lengths, np.inf), face

    def plane_lengths(self, face: Ints, origin: Floats, directions: Floats) -> Floats:
        """Return (n,) distances to the planes of faces (n,), in units of the directions."""
        normals = self.normals[face]
        height = np.einsum('ij,ij->i', normals, self.vertices_xyz[self.faces[face, 0]] - origin)
        return np.asarray(height / np.einsum('ij,ij->i', normals, directions))

    def in_shadow(self, points_xyz: Floats, normals: Floats, source: Floats) -> Bools:
        """Return (n,) bool: whether points (n, 3) are occluded from ``source`` (3,)."""
        if not len(points_xyz):
            return np.zeros(0, dtype=bool)
        start = points_xyz + _SHADOW_RAY_OFFSET * normals
        occluded = self._rays.test_occlusions(
            _ray_tensor(start, source - start), tnear=0.0, tfar=1.0
        )
        return np.asarray(occluded.numpy(), dtype=bool)


def _bodies(
    solid: Solid | None, platter: Platter | None, reflectance: float
) -> list[tuple[Solid, float]]:
    bodies = [] if solid is None else [(solid, reflectance)]
    if platter is not None:
        bodies.append((_disc(platter.radius), platter.reflectance))
    return bodies


def _disc(radius: float) -> Solid:
    angles = 2 * np.pi * np.arange(_DISC_EDGES) / _DISC_EDGES
    vertices = np.zeros((_DISC_EDGES + 1, 3))
    vertices[1:, 0], vertices[1:, 1] = radius * np.cos(angles), radius * np.sin(angles)
    first = np.arange(1, _DISC_EDGES + 1)
    faces = np.stack([np.zeros_like(first), first, np.roll(first, -1)], axis=1)
    return Solid(vertices_xyz=vertices, faces=faces)


def _raycaster(vertices_xyz: Floats, faces: Ints) -> Any:
    import open3d  # takes seconds

    scene = open3d.t.geometry.RaycastingScene()
    if len(faces):
        scene.add_triangles(
            open3d.core.Tensor.from_numpy(vertices_xyz.astype(np.float32)),
            open3d.core.Tensor.from_numpy(faces.astype(np.uint32)),
        )
    return scene


def _ray_tensor(origins: Floats, directions: Floats) -> Any:
    import open3d

    rays = np.concatenate([origins, directions], axis=1, dtype=np.float32)
    return open3d.core.Tensor.from_numpy(rays)


def part_from_camera(camera_from_base: Floats, angle: float) -> Floats:
    """Return (4, 4) rigid turntable_from_camera at a table angle in radians."""
    turn = transforms.rigid(transforms.rotation_z(-angle), np.zeros(3))
    return np.asarray(turn @ transforms.invert(camera_from_base))
