# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Cells whose lights and cameras stand differently, so that light goes twice differently."""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.cell import Turntable
from ivfmc_ros.model import Floats
from ivfmc_ros.simulation.bench import axial_plane
from ivfmc_ros.simulation.bench import look_at_axis
from ivfmc_ros.simulation.render.sources import LaserSource

SIZE = (1280, 960)  # pixels
FOCAL_LENGTH = 2350.0  # pixels: 0.17 mm a pixel at 0.4 m


@dataclass(frozen=True, eq=False, kw_only=True)
class Rig:
    """
    A cell, where its lasers stand, and how thick their sheets are.

    sources : position of each laser, ``camera_optical_frame``, meters
    sheet : meters, 1 sigma of the light sheets at the axis
    """

    cell: Cell
    sources: tuple[LaserSource, ...]
    sheet: float


def make_rig(
    distance: float,
    elevation: float,
    aim: float,
    azimuths: tuple[float, float],
    rises: tuple[float, float],
    sheet: float,
) -> Rig:
    """
    Return a rig of two lasers whose planes contain the table's axis.

    distance, elevation, aim : of the camera: meters, degrees, meters above the platter
    azimuths, rises : of each laser about the axis and above the platter, degrees
    sheet : meters, 1 sigma
    """
    camera_from_base = look_at_axis(distance, np.radians(elevation), aim)
    width, height = SIZE
    K = np.array(
        [
            [FOCAL_LENGTH, 0.0, (width - 1) / 2],
            [0.0, FOCAL_LENGTH, (height - 1) / 2],
            [0.0, 0.0, 1.0],
        ]
    )
    camera = Camera(width=width, height=height, K=K, distortion=np.zeros(5), name='metal')
    angles = np.radians(azimuths)
    cell = Cell(
        camera=camera,
        turntable=Turntable(camera_from_base=camera_from_base),
        lasers=tuple(
            axial_plane(name, float(angle), camera_from_base)
            for name, angle in zip(('left', 'right'), angles, strict=True)
        ),
    )
    sources = tuple(
        LaserSource(position=transforms.apply(camera_from_base, _place(angle, rise, aim)))
        for angle, rise in zip(angles, np.radians(rises), strict=True)
    )
    return Rig(cell=cell, sources=sources, sheet=sheet)


def _place(azimuth: float, rise: float, aim: float) -> Floats:
    """Return where a laser stands, 0.35 m from the point of the axis that it shines at."""
    level = 0.35 * np.cos(rise)
    return np.array([level * np.cos(azimuth), level * np.sin(azimuth), aim + 0.35 * np.sin(rise)])


# Camera and laser both high: the concave corner sends what went twice back to the camera.
RIGS = {
    'high': make_rig(0.40, 36.0, 0.020, (27.0, -33.0), (42.0, 38.0), 0.17e-3),
    'low': make_rig(0.41, 20.0, 0.022, (36.0, -30.0), (30.0, 24.0), 0.20e-3),
    'steep': make_rig(0.39, 42.0, 0.018, (31.0, -26.0), (36.0, 45.0), 0.16e-3),
    'flat': make_rig(0.42, 27.0, 0.021, (-34.0, 29.0), (40.0, 22.0), 0.21e-3),
}
