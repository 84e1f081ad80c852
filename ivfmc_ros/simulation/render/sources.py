# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where laser light comes from, which decides shading and shadows."""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.laser import LaserPlane
from ivfmc_ros.model import Floats

RING = 0.4  # metres from the axis
ELEVATION = np.radians(30.0)
AIM_HEIGHT = 0.045  # metres above the platter
_PARALLEL = 0.1


@dataclass(frozen=True, eq=False, kw_only=True)
class LaserSource:
    """
    The point that a sheet of light fans out from; ``cell.yaml`` has no need of it.

    position : (3,) metres, ``camera_optical_frame``
    """

    position: Floats


def usual_source(cell: Cell, laser: LaserPlane) -> LaserSource:
    """Return a source in the sheet's plane, on the camera's side of the table and above it."""
    base = cell.turntable.camera_from_base
    aim = base[:3, :3] @ (0.0, 0.0, AIM_HEIGHT) + base[:3, 3]
    aim = aim - laser.normal * (laser.normal @ aim + laser.offset)
    sideways = _in_plane(base[:3, 0], laser.normal)
    if np.linalg.norm(sideways) < _PARALLEL:
        sideways = _in_plane(base[:3, 1], laser.normal)
    sideways = sideways / np.linalg.norm(sideways)
    upward = np.cross(laser.normal, sideways)
    upward = upward * np.sign(upward @ base[:3, 2] or 1.0)
    # a sheet that lies level cannot come from above
    elevation = ELEVATION if abs(upward @ base[:3, 2]) > _PARALLEL else 0.0
    direction = np.cos(elevation) * sideways + np.sin(elevation) * upward
    return LaserSource(position=aim + RING * direction)


def usual_sources(cell: Cell) -> tuple[LaserSource, ...]:
    """Return one source a laser, in the order of the cell."""
    return tuple(usual_source(cell, laser) for laser in cell.lasers)


def _in_plane(vector: Floats, normal: Floats) -> Floats:
    return np.asarray(vector - normal * (normal @ vector))
