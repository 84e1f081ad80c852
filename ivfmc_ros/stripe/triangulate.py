# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From stripe positions to points: the ray of a pixel meets the sheet of the laser."""

import numpy as np

from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.laser import LaserPlane
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Frame
from ivfmc_ros.model import Profile
from ivfmc_ros.stripe.extract import Stripe

# Half the pixel step of the numerical derivative dX/du.
_STEP = 0.25


def triangulate(cell: Cell, frame: Frame, stripe: Stripe) -> Profile:
    """
    Turn the stripe of a picture into points on the part.

    The point is where the undistorted ray of the pixel meets the laser's sheet, turned back by
    the table's angle. Its sigma is the stripe's sigma in pixels times |dX/du|, the way that the
    point goes in the sheet when the stripe's position changes by a pixel.

    returns : Profile in ``turntable``, without the pixels whose ray misses the sheet
    """
    laser = cell.lasers[frame.laser]
    points = laser.intersect(cell.camera.rays(stripe.uv))
    seen = np.isfinite(points[:, 0])
    stripe, points = stripe[seen], points[seen]
    return Profile(
        points_xyz=cell.turntable.to_part(points, frame.angle),
        intensity=stripe.intensity,
        sigma=stripe.sigma * np.linalg.norm(sensitivity(cell, laser, stripe.uv), axis=1),
        uv=stripe.uv,
        angle=frame.angle,
        laser=frame.laser,
        view=frame.view,
        seq=frame.seq,
        stamp_ns=frame.stamp_ns,
        speed=frame.speed,
    )


def sensitivity(cell: Cell, laser: LaserPlane, uv: Floats) -> Floats:
    """
    Return dX/du, (n, 3) metres per pixel in ``camera_optical_frame``.

    u is the direction in which the stripe is measured: along a row for 'rows', along a column
    for 'columns'.
    """
    step = np.array([_STEP, 0.0] if laser.stripe == 'rows' else [0.0, _STEP])
    ahead = laser.intersect(cell.camera.rays(uv + step))
    behind = laser.intersect(cell.camera.rays(uv - step))
    return np.asarray((ahead - behind) / (2.0 * _STEP))
