# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Triangulation: intersection of the pixel rays of a stripe with the laser plane."""

import numpy as np

from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.laser import LaserPlane
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Frame
from ivfmc_ros.model import Profile
from ivfmc_ros.stripe.extract import Stripe

# Pixels, half step of the numerical derivative dX/du.
_STEP = 0.25


def triangulate(cell: Cell, frame: Frame, stripe: Stripe) -> Profile:
    """
    Triangulate the stripe of an image.

    Each undistorted pixel ray is intersected with the laser plane, and the point is rotated back
    by the table angle. The sigma of a point is the sigma of the stripe in pixels times |dX/du|,
    the distance in the laser plane per pixel.

    returns : Profile in ``turntable``, without the pixels whose ray misses the laser plane
    """
    laser = cell.lasers[frame.laser]
    rays = cell.camera.rays(stripe.uv)
    points = laser.intersect(rays)
    hit = np.isfinite(points[:, 0])
    if not hit.all():
        stripe, rays, points = stripe[hit], rays[hit], points[hit]
    derivatives = sensitivity(cell, laser, rays)
    return Profile(
        points_xyz=cell.turntable.to_part(points, frame.angle),
        intensity=stripe.intensity,
        sigma=stripe.sigma * np.sqrt((derivatives * derivatives).sum(axis=1)),
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
    Return the derivative dX/du of points by their pixel coordinate, (n, 3) meters per pixel.

    u is the coordinate across the stripe: the column for 'rows', the row for 'columns'. The
    points are in ``camera_optical_frame``.

    rays : (n, 3) rays to the points, z = 1
    """
    step = _STEP * cell.camera.ray_jacobian(rays, 'u' if laser.stripe == 'rows' else 'v')
    return np.asarray((laser.intersect(rays + step) - laser.intersect(rays - step)) / (2 * _STEP))
