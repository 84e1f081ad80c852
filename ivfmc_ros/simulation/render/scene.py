# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The part and the platter as rays meet them, in the frame ``turntable``."""

from typing import Any

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.simulation.parts.loading import Platter
from ivfmc_ros.simulation.parts.loading import Solid

NOTHING = -1  # the face that a ray meets when it meets none

_DISC_EDGES = 360
_LIFT = 1e-5  # metres; a shadow ray that starts on the surface must not meet it


class Scene:
    """
    Triangles that rays can be cast at.

    vertices_xyz : (n, 3) metres
    faces : (m, 3) int64, of the part first, then of the platter
    normals : (m, 3) outward
    reflectance : (m,) 1 is white
    """

    def __init__(self, solid: Solid | None, platter: Platter | None, reflectance: float) -> None:
        bodies = [(body, shine) for body, shine in _bodies(solid, platter, reflectance)]
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
            [shine for _, shine in bodies], [len(body.faces) for body, _ in bodies]
        )
        self.part_faces = len(solid.faces) if solid is not None else 0
        self._rays = _raycaster(self.vertices_xyz, self.faces)

    def cast(self, origin: Floats, directions: Floats) -> tuple[Floats, Ints]:
        """
        Return what rays meet first.

        origin : (3,) metres
        directions : (n, 3), of any length
        returns : (n,) how many lengths away, infinite for nothing; (n,) face, or NOTHING
        """
        if not len(self.faces):
            return np.full(len(directions), np.inf), np.full(len(directions), NOTHING)
        hits = self._rays.cast_rays(_packed(np.broadcast_to(origin, directions.shape), directions))
        face = hits['primitive_ids'].numpy().astype(np.int64)
        met = np.isfinite(hits['t_hit'].numpy())
        face[~met] = NOTHING
        # The ray caster has single precision; which face was met is right, how far is refined.
        with np.errstate(divide='ignore', invalid='ignore'):
            lengths = self.plane_lengths(face, origin, directions)
        return np.where(met, lengths, np.inf), face

    def plane_lengths(self, face: Ints, origin: Floats, directions: Floats) -> Floats:
        """Return how many lengths away rays (n, 3) meet the planes of faces (n,)."""
        normals = self.normals[face]
        height = np.einsum('ij,ij->i', normals, self.vertices_xyz[self.faces[face, 0]] - origin)
        return np.asarray(height / np.einsum('ij,ij->i', normals, directions))

    def shaded(self, points_xyz: Floats, normals: Floats, source: Floats) -> Bools:
        """Tell which points (n, 3) on faces with ``normals`` (n, 3) ``source`` (3,) cannot see."""
        if not len(points_xyz):
            return np.zeros(0, dtype=bool)
        start = points_xyz + _LIFT * normals
        shaded = self._rays.test_occlusions(_packed(start, source - start), tnear=0.0, tfar=1.0)
        return np.asarray(shaded.numpy(), dtype=bool)


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


def _packed(origins: Floats, directions: Floats) -> Any:
    import open3d

    rays = np.concatenate([origins, directions], axis=1, dtype=np.float32)
    return open3d.core.Tensor.from_numpy(rays)


def part_from_camera(camera_from_base: Floats, angle: float) -> Floats:
    """Return (4, 4) turntable <- camera_optical_frame at a table angle."""
    turn = transforms.rigid(transforms.rotation_z(-angle), np.zeros(3))
    return np.asarray(turn @ transforms.invert(camera_from_base))
