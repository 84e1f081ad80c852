# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Positions of the simulated laser sources, which determine shading and shadows."""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.laser import LaserPlane
from ivfmc_ros.model import Floats

SOURCE_DISTANCE = 0.4  # meters from the point aimed at
ELEVATION = np.radians(30.0)  # above the horizontal
AIM_HEIGHT = 0.045  # meters above the platter, half the height of the demo part
# Length of a unit vector's projection below which it counts as normal to the plane.
_MIN_PROJECTION = 0.1


@dataclass(frozen=True, eq=False, kw_only=True)
class LaserSource:
    """
    The point from which a laser plane fans out; it is not part of ``cell.yaml``.

    position : (3,) meters, ``camera_optical_frame``
    """

    position: Floats


def default_source(cell: Cell, laser: LaserPlane) -> LaserSource:
    """Return a source in the laser plane, on the camera's side of the table and above it."""
    base = cell.turntable.camera_from_base
    aim = base[:3, :3] @ (0.0, 0.0, AIM_HEIGHT) + base[:3, 3]
    aim = aim - laser.normal * (laser.normal @ aim + laser.offset)
    sideways = _in_plane(base[:3, 0], laser.normal)
    if np.linalg.norm(sideways) < _MIN_PROJECTION:
        sideways = _in_plane(base[:3, 1], laser.normal)
    sideways = sideways / np.linalg.norm(sideways)
    upward = np.cross(laser.normal, sideways)
    upward = upward * np.sign(upward @ base[:3, 2] or 1.0)
    # a horizontal laser plane has no elevation
    elevation = ELEVATION if abs(upward @ base[:3, 2]) > _MIN_PROJECTION else 0.0
    direction = np.cos(elevation) * sideways + np.sin(elevation) * upward
    return LaserSource(position=aim + SOURCE_DISTANCE * direction)


def default_sources(cell: Cell) -> tuple[LaserSource, ...]:
    """Return one source per laser, in the order of the cell."""
    return tuple(default_source(cell, laser) for laser in cell.lasers)


def _in_plane(vector: Floats, normal: Floats) -> Floats:
    return np.asarray(vector - normal * (normal @ vector))
