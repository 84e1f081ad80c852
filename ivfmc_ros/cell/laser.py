# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Laser sheet: a plane, or a plane with a bow, and its intersection with camera rays."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ivfmc_ros.errors import CellError
from ivfmc_ros.model import Floats
from ivfmc_ros.validation import require_in_range

# meters; with the camera center nearer to the plane, the image of the stripe does not depend on
# depth.
MIN_CAMERA_DISTANCE = 1e-3
# meters, 1 sigma; a thicker sheet gives no stripe.
MAX_THICKNESS = 0.01
# Tolerance of unit vectors: files give six decimals.
_UNIT_TOLERANCE = 1e-6

Stripe = Literal['rows', 'columns']


@dataclass(frozen=True, eq=False, kw_only=True)
class Bow:
    """
    Quadratic deviation of a sheet from its plane, in ``camera_optical_frame``.

    The sheet is n.X + d = a s^2 + b s t + c t^2 with s = along.(X - center) and
    t = (n x along).(X - center), meters. A cylindrical lens that is tilted to the beam projects
    such a shallow cone.

    center : (3,) meters, on the plane
    along : (3,) unit vector in the plane
    coefficients : (3,) a, b, c in 1/meter
    """

    center: Floats
    along: Floats
    coefficients: Floats


@dataclass(frozen=True, eq=False, kw_only=True)
class LaserPlane:
    """
    Plane of one laser in ``camera_optical_frame``.

    normal, offset : (3,) unit vector n and d in meters, with n.X + d = 0
    stripe : 'rows' has one stripe point per image row, 'columns' one per image column
    residual_rms : meters, of the calibration
    covariance : (4, 4) of (nx, ny, nz, d), or None
    volume : (2, 3) meters, bounding box of the points of the calibration, or None
    thickness : meters, 1 sigma of the sheet across its plane at the part; 0 if not known
    :raises CellError: a value is impossible, or the plane passes through the camera center
    """

    name: str
    normal: Floats
    offset: float
    stripe: Stripe = 'rows'
    residual_rms: float = 0.0
    bow: Bow | None = None
    covariance: Floats | None = None
    volume: Floats | None = None
    thickness: float = 0.0

    def __post_init__(self) -> None:
        require_in_range(
            'thickness', self.thickness, 0.0, MAX_THICKNESS, 'm', open_high=True, error=CellError
        )
        if not abs(float(np.linalg.norm(self.normal)) - 1.0) <= _UNIT_TOLERANCE:
            raise CellError('plane: the normal (first three numbers) must have length 1')
        if not np.isfinite(self.offset):
            raise CellError('plane: the offset (fourth number) must be a finite number')
        if abs(self.offset) < MIN_CAMERA_DISTANCE:
            raise CellError(
                'plane: the camera center lies in the laser plane, nothing can be triangulated; '
                'move the laser aside'
            )
        if self.bow is not None:
            along = self.bow.along
            unit = abs(float(np.linalg.norm(along)) - 1.0) <= _UNIT_TOLERANCE
            if not (unit and abs(float(along @ self.normal)) <= _UNIT_TOLERANCE):
                raise CellError('bow: along: must be a unit vector in the plane')

    def distance(self, points_xyz: Floats) -> Floats:
        """
        Return the signed distance of points from the sheet.

        points_xyz : (n, 3) meters, in ``camera_optical_frame``
        returns : (n,) float64, meters (to second order in the bow)
        """
        distance = points_xyz @ self.normal + self.offset
        if self.bow is not None:
            s, t = self._in_plane(points_xyz - self.bow.center)
            a, b, c = self.bow.coefficients
            distance = distance - (a * s * s + b * s * t + c * t * t)
        return np.asarray(distance)

    def intersect(self, rays: Floats) -> Floats:
        """
        Intersect rays from the camera center with the sheet.

        rays : (n, 3) directions of unit depth, in ``camera_optical_frame``
        returns : (n, 3) float64, meters; NaN where there is no intersection in front of the camera
        """
        with np.errstate(divide='ignore', invalid='ignore'):
            depth = self._depth(rays)
            depth = np.where((depth > 0) & np.isfinite(depth), depth, np.nan)
        return rays * depth[:, None]

    def _depth(self, rays: Floats) -> Floats:
        linear = rays @ self.normal
        if self.bow is None:
            return np.asarray(-self.offset / linear)
        s_ray, t_ray = self._in_plane(rays)
        s_center, t_center = self._in_plane(self.bow.center)
        a, b, c = self.bow.coefficients
        # X = depth * ray, inserted into the sheet's equation: A depth^2 + B depth + C = 0
        A = -(a * s_ray**2 + b * s_ray * t_ray + c * t_ray**2)
        B = linear + 2 * a * s_ray * s_center + 2 * c * t_ray * t_center
        B = B + b * (s_ray * t_center + t_ray * s_center)
        C = self.offset - (a * s_center**2 + b * s_center * t_center + c * t_center**2)
        # the root near the plane, in the form without cancellation
        root = np.sqrt(B * B - 4 * A * C)
        return np.asarray(-2 * C / (B + np.copysign(root, B)))

    def _in_plane(self, vectors: Floats) -> tuple[Floats, Floats]:
        if self.bow is None:
            raise ValueError('a plane without bow has no in-plane axes')
        across = np.cross(self.normal, self.bow.along)
        return vectors @ self.bow.along, vectors @ across
