# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Alignment by a datum system of up to three features A, B, C (ISO 5459).

The first datum takes what it determines of rotation and translation, the second what is left, then
the third. What no datum determines stays as the best fit has it.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.inspection import features
from ivfmc_ros.inspection.alignment import align
from ivfmc_ros.inspection.alignment import Alignment
from ivfmc_ros.inspection.edges import edge_distance
from ivfmc_ros.inspection.edges import region_of_faces
from ivfmc_ros.inspection.mesh_file import MeshBody
from ivfmc_ros.inspection.regions import segment_surface
from ivfmc_ros.inspection.sampled_mesh import sampled
from ivfmc_ros.inspection.settings import InspectSettings
from ivfmc_ros.model import Floats
from ivfmc_ros.surface import Surface

_MAX_DATUMS = 3
_KINDS = ('plane', 'cylinder')
# Greatest distance of a point from the nominal that belongs to a datum feature, meters.
_MAX_DISTANCE = 2e-3
# Points of a datum feature.
_MIN_POINTS, _MAX_POINTS = 6, 20_000
# Two directions at a smaller sine are parallel: the second determines no rotation (6 degrees).
_MIN_SINE = 0.1
_ROUNDS = 3  # the points of a feature depend on the alignment


def align_features(
    mesh: MeshBody, nominal: MeshBody, names: Sequence[str], settings: InspectSettings
) -> Alignment:
    """
    Align a mesh by features of the nominal.

    names : of planes and cylinders of the nominal, in the order A, B, C
    :raises ParameterError: a name is unknown, or of another kind of feature; or too many
    :raises GeometryError: a datum feature is not measured
    """
    regions = {r.name: r for r in segment_surface(nominal.vertices_xyz, nominal.faces)}
    datums = []
    for name in names:
        region = regions.get(name)
        if region is None or region.shape is None or region.shape.kind not in _KINDS:
            usable = [r.name for r in regions.values() if r.shape and r.shape.kind in _KINDS]
            raise ParameterError(f'datums: {name!r} is not one of {", ".join(usable)}')
        datums.append((list(regions).index(name), region.shape))
    if not 0 < len(datums) <= _MAX_DATUMS:
        raise ParameterError(f'datums: one to {_MAX_DATUMS} are needed, there are {len(datums)}')
    surface = Surface(nominal.vertices_xyz, nominal.faces)
    of_face = region_of_faces(list(regions.values()), len(nominal.faces))
    points = _sound_points(sampled(mesh)) * settings.conditions.to_reference
    T = align(points, surface, nominal.vertices_xyz, 'best_fit').nominal_from_mesh
    for _ in range(_ROUNDS):
        moved = transforms.apply(T, points)
        near = surface.nearest(moved)
        distance = edge_distance(nominal.vertices_xyz, nominal.faces, of_face, moved)
        good = (near.distance < _MAX_DISTANCE) & (distance > settings.edge)
        owner = np.where(good, of_face[near.faces], -1)
        pairs: list[tuple[features.Feature, features.Feature]] = []
        for number, shape in datums:
            own = moved[owner == number]
            if len(own) < _MIN_POINTS:
                raise GeometryError(
                    f'datums: {names[len(pairs)]!r} has {len(own)} measured vertices farther than '
                    f'{1e3 * settings.edge:g} mm from its edges, {_MIN_POINTS} are needed; name '
                    'another datum, or scan it in finer steps'
                )
            own = own[:: max(1, len(own) // _MAX_POINTS)]
            axis = shape.axis if shape.kind == 'cylinder' else None
            pairs.append((features.fit(shape.kind, own, axis), shape))
        T = _motion(pairs) @ T
    rms = float(np.sqrt(np.mean(surface.nearest(transforms.apply(T, points)).distance ** 2)))
    return Alignment(nominal_from_mesh=T, rms=rms, method='datum')


def _sound_points(mesh: MeshBody) -> Floats:
    used = np.unique(mesh.faces)
    if mesh.sigma is not None and np.isfinite(mesh.sigma[used]).any():
        used = used[np.isfinite(mesh.sigma[used])]
    return mesh.vertices_xyz[used]


def _motion(pairs: Sequence[tuple[features.Feature, features.Feature]]) -> Floats:
    """Return the motion (4, 4) that brings measured features onto nominal ones, in order."""
    R = _rotation(pairs)
    taken = np.zeros((0, 3))
    t = np.zeros(3)
    for measured, nominal in pairs:
        gap = nominal.center_xyz - (R @ measured.center_xyz + t)
        axis = nominal.axis
        directions = axis[None] if nominal.kind == 'plane' else np.linalg.svd(axis[None])[2][1:]
        for direction in directions:
            free = direction - taken.T @ (taken @ direction)
            size = float(np.linalg.norm(free))
            if size < _MIN_SINE:
                continue
            free = free / size
            # along the free direction until the datum fits in its own direction
            t = t + (gap @ direction) / size * free
            gap = nominal.center_xyz - (R @ measured.center_xyz + t)
            taken = np.concatenate([taken, free[None]])
    return transforms.rigid(R, t)


def _rotation(pairs: Sequence[tuple[features.Feature, features.Feature]]) -> Floats:
    """Return the rotation that brings the directions of the features together, in order."""
    frames: list[list[Floats]] = [[], []]
    for measured, nominal in pairs:
        sign = np.copysign(1.0, measured.axis @ nominal.axis)
        for place, axis in enumerate((sign * measured.axis, nominal.axis)):
            frames[place].append(axis)
    # parallel cylinders give a direction by the line between their axes
    round_ = [pair for pair in pairs if pair[1].kind == 'cylinder']
    for (measured, nominal), (other, other_nominal) in pairwise(round_):
        frames[0].append(other.center_xyz - measured.center_xyz)
        frames[1].append(other_nominal.center_xyz - nominal.center_xyz)
    own, wanted = (_orthonormal(directions) for directions in frames)
    if own is None or wanted is None:
        a, b = frames[0][0], frames[1][0]
        axis = np.cross(a, b)
        return _turn(a, b) if np.linalg.norm(axis) > 0 else np.eye(3)
    return np.asarray(wanted @ own.T)


def _orthonormal(directions: Sequence[Floats]) -> Floats | None:
    """Return axes (3, 3) from the first direction and the next that is not parallel to it."""
    z = directions[0] / np.linalg.norm(directions[0])
    for other in directions[1:]:
        size = float(np.linalg.norm(other))
        x = other - (other @ z) * z
        if size > 0 and np.linalg.norm(x) > _MIN_SINE * size:
            x = x / np.linalg.norm(x)
            return np.stack([x, np.cross(z, x), z], axis=1)
    return None


def _turn(a: Floats, b: Floats) -> Floats:
    """Return the smallest rotation from unit vector a to b (Rodrigues)."""
    v, c = np.cross(a, b), float(a @ b)
    K = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    return np.asarray(np.eye(3) + K + K @ K / (1.0 + c))
