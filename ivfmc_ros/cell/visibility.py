# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""At which table angles a point of the part is lit, and whether the camera sees it there."""

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats

# Minimum cosine between the normal and the direction to the camera of a point that is measured.
_MIN_FACING = 0.1


def lit_angles(cell: Cell, laser: int, points_xyz: Floats) -> Floats:
    """
    Return the two table angles at which points lie in a laser plane, (2, n) radians.

    laser : index in the order of the cell
    points_xyz : (n, 3) meters in ``turntable``; NaN for those that never do
    """
    T = cell.turntable.camera_from_base
    plane = cell.lasers[laser]
    normal = T[:3, :3].T @ plane.normal
    offset = plane.offset + float(plane.normal @ T[:3, 3]) + normal[2] * points_xyz[:, 2]
    a = normal[0] * points_xyz[:, 0] + normal[1] * points_xyz[:, 1]
    b = normal[1] * points_xyz[:, 0] - normal[0] * points_xyz[:, 1]
    size = np.hypot(a, b)
    with np.errstate(invalid='ignore', divide='ignore'):
        half = np.arccos(-offset / size)
    return np.stack([np.arctan2(b, a) + half, np.arctan2(b, a) - half])


def lines_of_sight(cell: Cell, points_xyz: Floats, angle: Floats) -> Floats:
    """
    Return the vectors from points to the camera, (n, 3) meters in ``turntable``.

    points_xyz : (n, 3) meters; angle : (n,) radians, of the table; NaN counts as 0
    """
    eye = cell.turntable.to_part(np.zeros((1, 3)), 0.0)
    turns = transforms.rotation_z(-np.nan_to_num(angle))
    return np.asarray((turns @ eye[0]) - points_xyz)


def faces_camera(cell: Cell, points_xyz: Floats, normals: Floats, angle: Floats) -> Bools:
    """
    Return whether the surface at points is turned to the camera, (n,) bool.

    normals : (n, 3) unit; the rest as for ``lines_of_sight``, but false where the angle is NaN
    """
    sight = lines_of_sight(cell, points_xyz, angle)
    facing = (sight * normals).sum(axis=1) / np.linalg.norm(sight, axis=1)
    return np.asarray(np.isfinite(angle) & (facing > _MIN_FACING))
