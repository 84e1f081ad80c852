# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Nominal cell (camera pose, laser planes) from lengths measured by hand, to start with.

The frame is ``turntable_base``: origin where the axis meets the platter, z up along the axis. The
camera stands upright over the x axis and looks at the axis.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.cell import Turntable
from ivfmc_ros.cell.laser import LaserPlane
from ivfmc_ros.cell.laser import Stripe as Direction
from ivfmc_ros.model import Floats


@dataclass(frozen=True, kw_only=True)
class PaperGeometry:
    """
    Arrangement of the paper (Ismail et al., ISITS 2007): the camera above the laser.

    The laser plane contains the y axis and runs from the laser towards the table axis; its stripe
    lies along the rows of the picture. Lengths in meters.

    distance : D, from the axis to the camera, horizontally
    height : H, of the camera above the laser
    tilt : α, radians by which the camera looks down
    laser_height : of the laser above the platter
    axis_height : above the platter, at which the laser plane meets the axis; None if horizontal
    """

    distance: float
    height: float
    tilt: float
    laser_height: float = 0.0
    axis_height: float | None = None


@dataclass(frozen=True, kw_only=True)
class AxialLaser:
    """A laser whose plane contains the table axis; azimuth in radians from the camera, about z."""

    name: str
    azimuth: float


def paper_cell(camera: Camera, geometry: PaperGeometry, name: str = 'laser') -> Cell:
    """
    Return the cell of the paper's arrangement.

    :raises CellError: the camera lies in the laser plane
    """
    center = np.array([geometry.distance, 0.0, geometry.laser_height + geometry.height])
    camera_from_base = _camera_from_base(center, geometry.tilt)
    axis_height = geometry.laser_height if geometry.axis_height is None else geometry.axis_height
    along = np.array([-geometry.distance, 0.0, axis_height - geometry.laser_height])
    plane = _plane(
        name,
        np.cross(along, [0.0, 1.0, 0.0]),
        np.array([0.0, 0.0, axis_height]),
        camera_from_base,
        'columns',
    )
    return _cell(camera, camera_from_base, [plane])


def axial_cell(
    camera: Camera, distance: float, elevation: float, aim: float, lasers: Sequence[AxialLaser]
) -> Cell:
    """
    Return the cell of a camera that looks at the axis, and laser planes through the axis.

    distance : meters from the camera to the point on the axis that it looks at
    elevation : radians of the camera above the horizontal, seen from that point
    aim : height in meters of that point above the platter
    lasers : name and azimuth of each
    :raises CellError: the camera lies in a laser plane
    """
    height = aim + distance * np.sin(elevation)
    center = np.array([distance * np.cos(elevation), 0.0, height])
    camera_from_base = _camera_from_base(center, elevation)
    planes = [
        _plane(
            laser.name,
            np.array([-np.sin(laser.azimuth), np.cos(laser.azimuth), 0.0]),
            np.zeros(3),
            camera_from_base,
            'rows',
        )
        for laser in lasers
    ]
    return _cell(camera, camera_from_base, planes)


def _camera_from_base(center: Floats, tilt: float) -> Floats:
    forward = np.array([-np.cos(tilt), 0.0, -np.sin(tilt)])
    right = np.array([0.0, 1.0, 0.0])
    base_from_camera = np.stack([right, np.cross(forward, right), forward], axis=1)
    return transforms.rigid(base_from_camera.T, -base_from_camera.T @ center)


def _plane(
    name: str, normal: Floats, point: Floats, camera_from_base: Floats, stripe: Direction
) -> LaserPlane:
    """Return the plane with a normal and a point in turntable_base, in the camera frame."""
    in_camera = camera_from_base[:3, :3] @ (normal / np.linalg.norm(normal))
    offset = -in_camera @ transforms.apply(camera_from_base, point)
    return LaserPlane(name=name, normal=in_camera, offset=float(offset), stripe=stripe)


def _cell(camera: Camera, camera_from_base: Floats, lasers: Sequence[LaserPlane]) -> Cell:
    turntable = Turntable(camera_from_base=camera_from_base)
    return Cell(camera=camera, turntable=turntable, lasers=tuple(lasers))
