# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Poses in which a part rests on the platter: on a flat of its convex hull, below its centroid."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial import QhullError
from scipy.spatial.transform import Rotation

from ivfmc_ros.cell import transforms
from ivfmc_ros.inspection.mesh_file import MeshBody
from ivfmc_ros.meshing.geometry.areas import face_areas
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints

# Smallest area of a flat to rest on, share of the hull's: a round part is many small flats.
_MIN_AREA = 0.01
# Vertices of a flat are this near to its plane, fraction of the part's diagonal.
_FLAT = 1e-4
# Planes of normals and distances (in diagonals) that agree so far are sought as one.
_SAME_PLANE = 1e-3
# Least distance of the centroid from the border of the flat, fraction of the flat's size.
_STABLE = 0.02


@dataclass(frozen=True, eq=False, kw_only=True)
class RestingPose:
    """
    A pose of a part that stands by itself.

    table_from_part : (4, 4), the flat at z = 0 and the middle of the part on the table axis
    down : (3,) unit vector in the frame of the part, normal of the flat
    height : meters, of the flat along ``down``
    area : square meters, of the flat, its gaps included
    """

    table_from_part: Floats
    down: Floats
    height: float
    area: float


def resting_poses(part: MeshBody) -> list[RestingPose]:
    """
    Return the poses in which a closed part rests on a flat, the largest flat first.

    Empty for a part without volume.
    """
    try:
        hull = ConvexHull(part.vertices_xyz)
    except (QhullError, ValueError):
        return []
    corners = hull.points[hull.simplices]
    area = face_areas(hull.points, hull.simplices)
    centroid = volume_centroid(part.vertices_xyz, part.faces)
    found = []
    left = np.ones(len(area), dtype=bool)
    for seed in _seeds(hull.equations, area, part.diagonal):
        if not left[seed]:
            continue
        normal, height = hull.equations[seed, :3], -float(hull.equations[seed, 3])
        off = np.abs(corners @ normal - height).max(axis=1)
        flat = left & (off < _FLAT * part.diagonal)
        left &= ~flat
        size = float(area[flat].sum())
        border = hull.points[np.unique(hull.simplices[flat])]
        if size > _MIN_AREA * hull.area and _is_above(centroid, normal, border, size):
            T = _standing(part.vertices_xyz, normal, height)
            found.append(RestingPose(table_from_part=T, down=normal, height=height, area=size))
    return sorted(found, key=lambda pose: -pose.area)


def _seeds(equations: Floats, area: Floats, diagonal: float) -> Ints:
    """Return a triangle, the largest, of each plane that may be a flat."""
    planes = np.rint(equations / (_SAME_PLANE * np.array([1.0, 1.0, 1.0, diagonal])))
    _, plane = np.unique(planes, axis=0, return_inverse=True)
    plane = plane.reshape(-1)
    total = np.bincount(plane, area)
    # rounding may divide a flat
    order = np.argsort(-area)
    _, first = np.unique(plane[order], return_index=True)
    chosen = order[first[total > 0.25 * _MIN_AREA * area.sum()]]
    return np.asarray(chosen[np.argsort(-area[chosen])])


def volume_centroid(vertices_xyz: Floats, faces: Ints) -> Floats:
    """Return the centroid of the volume within a closed mesh, (3,) meters."""
    middle = vertices_xyz.mean(axis=0)
    corners = vertices_xyz[faces] - middle
    volumes = np.linalg.det(corners)
    return np.asarray(middle + volumes @ corners.sum(axis=1) / (4.0 * volumes.sum()))


def _is_above(point: Floats, normal: Floats, border: Floats, area: float) -> bool:
    """Return whether a point lies above the inner part of a flat with these border points."""
    plane = np.linalg.svd(normal[None])[2][1:]
    outline = ConvexHull(border @ plane.T)
    distances = outline.equations[:, :2] @ (plane @ point) + outline.equations[:, 2]
    return bool(distances.max() < -_STABLE * np.sqrt(area))


def _standing(vertices_xyz: Floats, normal: Floats, height: float) -> Floats:
    R = Rotation.align_vectors(np.array([[0.0, 0.0, -1.0]]), normal[None])[0].as_matrix()
    turned = vertices_xyz @ R.T
    middle = 0.5 * (turned.min(axis=0) + turned.max(axis=0))
    return transforms.rigid(R, np.array([-middle[0], -middle[1], height]))
