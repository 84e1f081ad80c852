# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
How to lay a part on the platter for a further scan, so that it shows what was not measured.

Of the poses in which the part stands by itself on a plane, the one that shows most is taken, then
the one that shows most of the rest. A point is seen where a laser plane crosses it at a table
angle at which the camera has a free view of it. Where the lasers stand is not known: their shadows
are not considered.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.visibility import faces_camera
from ivfmc_ros.cell.visibility import lines_of_sight
from ivfmc_ros.cell.visibility import lit_angles
from ivfmc_ros.inspection.mesh_file import MeshBody
from ivfmc_ros.inspection.regions import SurfaceRegion
from ivfmc_ros.inspection.resting_poses import resting_poses
from ivfmc_ros.inspection.resting_poses import RestingPose
from ivfmc_ros.meshing.geometry.areas import points_by_area
from ivfmc_ros.meshing.geometry.normals import face_normals
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.surface import Surface

# Points that stand for the surface of the nominal.
_POINTS = 6000
# A point is measured if a measured vertex that faces its way (60 degrees) is as near as this;
# those of a sampled mesh are up to 1 mm apart.
_MEASURED, _SAME_SIDE, _NEIGHBORS = 1.2e-3, 0.5, 8
# Proposed poses, and the least share of the missing surface that one shows.
_MOST, _LEAST_SHARE = 3, 0.05
# Share of the surface below which nothing is missing: edges are rounded.
_NOTHING = 0.01
# Meters above the surface at which a line of sight begins: the queries are in single precision.
_ABOVE = 2e-5
# Meters of all vertices of a region from the platter that it lies on.
_ON_PLANE = 2e-5


@dataclass(frozen=True, eq=False, kw_only=True)
class ProposedPose:
    """
    A pose for a further scan.

    rests_on : names of the plane regions of the nominal that lie on the platter, the largest first
    down : (3,) unit vector in the frame of the nominal
    shows : share of the surface that is missing until then, 0 to 1
    """

    rests_on: tuple[str, ...]
    down: Floats
    shows: float


@dataclass(frozen=True, eq=False, kw_only=True)
class MissingSurface:
    """
    What of a nominal was not measured, and how to get it.

    share : of the surface, 0 to 1
    poses : in the order in which to scan; empty where no pose shows more
    """

    share: float
    poses: tuple[ProposedPose, ...]


def missing_surface(
    nominal: MeshBody,
    regions: Sequence[SurfaceRegion],
    measured_xyz: Floats,
    measured_normals: Floats,
    cell: Cell,
) -> MissingSurface:
    """
    Return the share of a nominal that was not measured, and further poses.

    nominal : closed, normals outward; regions : of it
    measured_xyz, measured_normals : (n, 3) vertices of the mesh, in the frame of the nominal
    cell : in which the part is scanned
    """
    points, face = points_by_area(nominal.vertices_xyz, nominal.faces, _POINTS)
    normals = face_normals(nominal.vertices_xyz, nominal.faces[face])
    missing = ~_is_measured(points, normals, measured_xyz, measured_normals)
    share = float(missing.mean())
    points, normals = points[missing], normals[missing]
    surface = Surface(nominal.vertices_xyz, nominal.faces)
    poses = _poses_on_planes(nominal, regions) if len(points) else []
    seen = [_is_seen(points, normals, pose, surface, cell) for pose, _ in poses]
    left = np.ones(len(points), dtype=bool)
    found: list[ProposedPose] = []
    while poses and len(found) < _MOST and left.any():
        gains = [float(np.mean(own[left])) for own in seen]
        best = int(np.argmax(gains))
        if gains[best] * left.mean() < _LEAST_SHARE:
            break
        pose, rests_on = poses[best]
        found.append(ProposedPose(rests_on=rests_on, down=pose.down, shows=gains[best]))
        left &= ~seen[best]
    return MissingSurface(share=share, poses=tuple(found))


def _poses_on_planes(
    nominal: MeshBody, regions: Sequence[SurfaceRegion]
) -> list[tuple[RestingPose, tuple[str, ...]]]:
    """Return the poses with the planes that they rest on; those on edges where no other is."""
    poses = [(pose, _regions_below(pose, nominal, regions)) for pose in resting_poses(nominal)]
    return [(pose, names) for pose, names in poses if names] or poses


def missing_texts(missing: MissingSurface | None) -> list[str]:
    """Return what was not measured and how to lay the part next, in sentences."""
    if missing is None or missing.share < _NOTHING:
        return []
    texts = [f'{100.0 * missing.share:.0f} % of the surface of the nominal was not measured']
    left = 'of it'
    for pose in missing.poses:
        place = ', '.join(pose.rests_on) or 'the side of the normal ' + ', '.join(
            f'{value:.2f}' for value in pose.down
        )
        texts.append(f'lay the part on {place}: the camera sees {100.0 * pose.shows:.0f} % {left}')
        left = 'of the rest'
    return texts


def _is_measured(points: Floats, normals: Floats, vertices: Floats, own: Floats) -> Bools:
    if not len(vertices):
        return np.zeros(len(points), dtype=bool)
    count = min(_NEIGHBORS, len(vertices))
    distance, index = cKDTree(vertices).query(points, count, distance_upper_bound=_MEASURED)
    distance, index = distance.reshape(len(points), -1), index.reshape(len(points), -1)
    near = np.isfinite(distance)
    facing = np.einsum('nkc,nc->nk', own[np.where(near, index, 0)], normals)
    return np.asarray((near & (facing > _SAME_SIDE)).any(axis=1))


def _is_seen(
    points: Floats, normals: Floats, pose: RestingPose, surface: Surface, cell: Cell
) -> Bools:
    """Return which points a laser crosses while the camera has a free view of them, (n,)."""
    R = pose.table_from_part[:3, :3]
    placed, turned = transforms.apply(pose.table_from_part, points), normals @ R.T
    seen = np.zeros(len(points), dtype=bool)
    for laser in range(len(cell.lasers)):
        for angle in lit_angles(cell, laser, placed):
            chosen = np.flatnonzero(faces_camera(cell, placed, turned, angle) & ~seen)
            sight = lines_of_sight(cell, placed[chosen], angle[chosen]) @ R
            hits = surface.cast(points[chosen] + _ABOVE * normals[chosen], sight)
            # the vector ends at the camera
            seen[chosen[hits.distance > 1.0]] = True
    return seen


def _regions_below(
    pose: RestingPose, nominal: MeshBody, regions: Sequence[SurfaceRegion]
) -> tuple[str, ...]:
    names = []
    for region in regions:
        used = nominal.vertices_xyz[np.unique(nominal.faces[region.faces])]
        if np.abs(used @ pose.down - pose.height).max() < _ON_PLANE:
            names.append(region.name)
    return tuple(names)
