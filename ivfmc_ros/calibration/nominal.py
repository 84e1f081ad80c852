# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A first cell from measured lengths, good enough to see a stripe become a shape.

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
    The paper's arrangement: laser and camera one above the other, before the table.

    The laser's sheet is horizontal across the view (it holds the direction y) and leaves the
    laser towards the axis; its stripe lies along the picture's rows. Lengths in metres.

    distance : D, from the axis to the camera, horizontally
    height : H, of the camera above the laser
    tilt : α, radians by which the camera looks down
    laser_height : of the laser above the platter
    hits : height above the platter at which the sheet meets the axis; None for a level sheet
    """

    distance: float
    height: float
    tilt: float
    laser_height: float = 0.0
    hits: float | None = None


@dataclass(frozen=True, kw_only=True)
class AxialLaser:
    """A laser whose sheet is upright and holds the axis; azimuth in radians from the camera."""

    name: str
    azimuth: float


def paper_cell(camera: Camera, geometry: PaperGeometry, name: str = 'laser') -> Cell:
    """
    Return the cell of the paper's arrangement.

    :raises CellError: nothing can be triangulated in it
    """
    centre = np.array([geometry.distance, 0.0, geometry.laser_height + geometry.height])
    camera_from_base = _camera_from_base(centre, geometry.tilt)
    hits = geometry.laser_height if geometry.hits is None else geometry.hits
    along = np.array([-geometry.distance, 0.0, hits - geometry.laser_height])
    plane = _plane(
        name,
        np.cross(along, [0.0, 1.0, 0.0]),
        np.array([0.0, 0.0, hits]),
        camera_from_base,
        'columns',
    )
    return _cell(camera, camera_from_base, [plane])


def axial_cell(
    camera: Camera, distance: float, elevation: float, aim: float, lasers: Sequence[AxialLaser]
) -> Cell:
    """
    Return the cell of a camera that looks at a point of the axis, and lasers that hold the axis.

    distance : metres from the camera to the point
    elevation : radians of the camera above the platter, seen from the point
    aim : height in metres of the point above the platter
    :raises CellError: nothing can be triangulated in it
    """
    height = aim + distance * np.sin(elevation)
    centre = np.array([distance * np.cos(elevation), 0.0, height])
    camera_from_base = _camera_from_base(centre, elevation)
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


def _camera_from_base(centre: Floats, tilt: float) -> Floats:
    forward = np.array([-np.cos(tilt), 0.0, -np.sin(tilt)])
    right = np.array([0.0, 1.0, 0.0])
    base_from_camera = np.stack([right, np.cross(forward, right), forward], axis=1)
    return transforms.rigid(base_from_camera.T, -base_from_camera.T @ centre)


def _plane(
    name: str, normal: Floats, point: Floats, camera_from_base: Floats, stripe: Direction
) -> LaserPlane:
    """Return the plane with a normal and a point in the base, seen by the camera."""
    seen = camera_from_base[:3, :3] @ (normal / np.linalg.norm(normal))
    offset = -seen @ transforms.apply(camera_from_base, point)
    return LaserPlane(name=name, normal=seen, offset=float(offset), stripe=stripe)


def _cell(camera: Camera, camera_from_base: Floats, lasers: Sequence[LaserPlane]) -> Cell:
    turntable = Turntable(camera_from_base=camera_from_base)
    return Cell(camera=camera, turntable=turntable, lasers=tuple(lasers))
