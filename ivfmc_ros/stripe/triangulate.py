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
    rays = cell.camera.rays(stripe.uv)
    points = laser.intersect(rays)
    seen = np.isfinite(points[:, 0])
    if not seen.all():
        stripe, rays, points = stripe[seen], rays[seen], points[seen]
    slopes = sensitivity(cell, laser, rays)
    return Profile(
        points_xyz=cell.turntable.to_part(points, frame.angle),
        intensity=stripe.intensity,
        sigma=stripe.sigma * np.sqrt((slopes * slopes).sum(axis=1)),
        uv=stripe.uv,
        angle=frame.angle,
        laser=frame.laser,
        view=frame.view,
        seq=frame.seq,
        stamp_ns=frame.stamp_ns,
        speed=frame.speed,
    )


def sensitivity(cell: Cell, laser: LaserPlane, rays: Floats) -> Floats:
    """
    Return dX/du, (n, 3) metres per pixel in ``camera_optical_frame``.

    rays : (n, 3) of unit depth, to the points
    u is the direction in which the stripe is measured: along a row for 'rows', along a column
    for 'columns'.
    """
    step = _STEP * cell.camera.ray_slopes(rays, 'u' if laser.stripe == 'rows' else 'v')
    return np.asarray((laser.intersect(rays + step) - laser.intersect(rays - step)) / (2 * _STEP))
