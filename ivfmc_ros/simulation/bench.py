# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The bench cell: fixed geometry, so that results measured in simulation can be compared."""

import numpy as np
from numpy.typing import ArrayLike

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.cell import Turntable
from ivfmc_ros.cell.laser import LaserPlane
from ivfmc_ros.model import Floats

SIZE = (1280, 1024)  # pixels, width and height
FOCAL_LENGTH = 2350.0  # pixels
CAMERA_DISTANCE = 0.4  # meters, from the point of the axis that the camera looks at
AIM_HEIGHT = 0.045  # meters above the platter
CAMERA_ELEVATION = np.radians(20.0)
# At equal angles the table's angle errors of order 6 and 12 would be unobservable.
LASER_AZIMUTHS = {'left': np.radians(36.0), 'right': np.radians(-30.0)}
MILD_DISTORTION = (-0.05, 0.01, 0.0, 0.0, 0.0)  # plumb_bob: k1, k2, p1, p2, k3

VOLUME_RADIUS = 0.06  # meters, working volume: a cylinder that stands on the platter
VOLUME_HEIGHT = 0.1  # meters


def bench_cell(distortion: ArrayLike = MILD_DISTORTION) -> Cell:
    """
    Return the bench cell without calibration errors.

    The camera is at azimuth 0 of ``turntable_base``. The lasers are named as seen by an observer
    who faces the camera across the table: 'left' is on the right side of the image.

    distortion : (5,) plumb_bob coefficients of the lens
    """
    camera_from_base = look_at_axis(CAMERA_DISTANCE, CAMERA_ELEVATION, AIM_HEIGHT)
    return Cell(
        camera=bench_camera(distortion),
        turntable=Turntable(camera_from_base=camera_from_base),
        lasers=tuple(
            axial_plane(name, azimuth, camera_from_base)
            for name, azimuth in LASER_AZIMUTHS.items()
        ),
    )


def bench_camera(distortion: ArrayLike = MILD_DISTORTION) -> Camera:
    """Return the bench cell's camera; its principal point is the center of the image."""
    width, height = SIZE
    K = np.array(
        [
            [FOCAL_LENGTH, 0.0, (width - 1) / 2],
            [0.0, FOCAL_LENGTH, (height - 1) / 2],
            [0.0, 0.0, 1.0],
        ]
    )
    coefficients = np.asarray(distortion, dtype=np.float64)
    return Camera(width=width, height=height, K=K, distortion=coefficients, name='bench')


def look_at_axis(distance: float, elevation: float, height: float) -> Floats:
    """
    Return camera_from_base of an upright camera at azimuth 0 that looks at the table's axis.

    distance : meters from the camera center to the point of the axis
    elevation : radians above the platter
    height : meters, of the point above the platter
    returns : (4, 4) rigid
    """
    back = np.array([np.cos(elevation), 0.0, np.sin(elevation)])
    right = np.array([0.0, 1.0, 0.0])
    base_from_camera = np.stack([right, np.cross(-back, right), -back], axis=1)
    center = distance * back + (0.0, 0.0, height)
    return transforms.rigid(base_from_camera.T, -base_from_camera.T @ center)


def axial_plane(name: str, azimuth: float, camera_from_base: Floats) -> LaserPlane:
    """Return the laser plane through the table's axis at ``azimuth`` (radians, base frame)."""
    normal_base = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    normal = camera_from_base[:3, :3] @ normal_base
    normal /= np.linalg.norm(normal)
    return LaserPlane(name=name, normal=normal, offset=float(-normal @ camera_from_base[:3, 3]))
