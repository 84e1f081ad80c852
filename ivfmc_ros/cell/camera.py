# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pinhole camera with lens distortion, as sensor_msgs/CameraInfo describes it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any
from typing import Literal

import cv2
import numpy as np
from numpy.typing import ArrayLike

from ivfmc_ros.errors import CellError
from ivfmc_ros.model import Floats
from ivfmc_ros.validation import require_one_of

# Number of coefficients of each ROS distortion model (sensor_msgs/CameraInfo)
DISTORTION_COEFFICIENTS = {'plumb_bob': 5, 'rational_polynomial': 8}

# Numbers of coefficients that OpenCV knows; a shorter vector stands for one with zeros at its end.
_OPENCV_COUNTS = (0, 4, 5, 8, 12, 14)

# OpenCV stops after 5 iterations by default, which leaves 0.01 px at the edge of a strong lens.
_TERMINATION = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12)
# Greatest distance, in pixels, between a pixel and the projection of its ray.
_MAX_REPROJECTION = 1e-3


@dataclass(frozen=True, eq=False, kw_only=True)
class Camera:
    """
    Camera model in ``camera_optical_frame`` (z forward, x right, y down).

    width, height : pixels
    K : (3, 3) float64 camera matrix, pixels
    distortion : (5,) for plumb_bob or (8,) for rational_polynomial, OpenCV's order
    model : ROS name of the distortion model
    covariance : (4 + n, 4 + n) of fx, fy, cx, cy and the n distortion coefficients, or None
    :raises CellError: a value is impossible
    """

    width: int
    height: int
    K: Floats
    distortion: Floats
    model: str = 'plumb_bob'
    name: str = 'camera'
    covariance: Floats | None = None

    def __post_init__(self) -> None:
        if self.width <= 0 or self.height <= 0:
            raise CellError(f'image size {self.width} x {self.height} is not positive')
        if self.K.shape != (3, 3) or not np.isfinite(self.K).all():
            raise CellError('camera_matrix: 9 finite numbers are needed')
        if self.K[0, 0] <= 0 or self.K[1, 1] <= 0:
            raise CellError('camera_matrix: the focal lengths must be positive')
        if not (0 < self.K[0, 2] < self.width and 0 < self.K[1, 2] < self.height):
            raise CellError('camera_matrix: the principal point lies outside the image')
        if np.any(self.K[[1, 2, 2], [0, 0, 1]] != 0) or self.K[2, 2] != 1 or self.K[0, 1] != 0:
            raise CellError('camera_matrix: must be [fx, 0, cx, 0, fy, cy, 0, 0, 1]')
        require_one_of('distortion_model', self.model, DISTORTION_COEFFICIENTS, error=CellError)
        expected = DISTORTION_COEFFICIENTS[self.model]
        if self.distortion.shape != (expected,) or not np.isfinite(self.distortion).all():
            raise CellError(f'distortion_coefficients: {self.model} has {expected} finite numbers')
        shape = (4 + expected, 4 + expected)
        if self.covariance is not None and self.covariance.shape != shape:
            raise CellError(f'covariance: {shape[0]} x {shape[0]} numbers are needed')

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        return self.width, self.height

    def rays(self, uv: ArrayLike) -> Floats:
        """
        Return the undistorted ray through each pixel, scaled to unit depth.

        uv : (n, 2) pixel (column, row)
        returns : (n, 3) float64, (x, y, 1) in ``camera_optical_frame``; x, y are NaN where the
            distortion model is not invertible and no ray reaches the pixel
        """
        pixels = np.asarray(uv, dtype=np.float64).reshape(-1, 1, 2)
        rays = np.ones((len(pixels), 3))
        if len(pixels):
            rays[:, :2] = _undistort(pixels, self.K, self.distortion).reshape(-1, 2)
            # OpenCV returns the last iterate, whether or not it converged
            error = np.abs(self._pixels(rays) - pixels[:, 0]).max(axis=1)
            rays[~(error < _MAX_REPROJECTION), :2] = np.nan
        return rays

    def project(self, points_xyz: ArrayLike) -> Floats:
        """
        Project points to the image, with distortion.

        points_xyz : (n, 3) meters, in ``camera_optical_frame``, in front of the camera
        returns : (n, 2) float64, pixel (column, row)
        """
        points = np.asarray(points_xyz, dtype=np.float64).reshape(-1, 1, 3)
        if not len(points):
            return np.empty((0, 2))
        zero = np.zeros(3)
        projected, _ = cv2.projectPoints(points, zero, zero, self.K, self.distortion)
        return np.asarray(projected, dtype=np.float64).reshape(-1, 2)

    def _pixels(self, rays: Floats) -> Floats:
        """
        Return the (n, 2) pixels of (n, 3) rays of unit depth.

        As ``project``, where OpenCV computes derivatives too: eight times as long for a profile.
        """
        x, y = rays[:, 0], rays[:, 1]
        square, (p1, p2) = x * x + y * y, self.distortion[2:4]
        radial, _ = self._radial(square)
        mixed = 2.0 * x * y
        u = x * radial + p1 * mixed + p2 * (square + 2.0 * x * x)
        v = y * radial + p1 * (square + 2.0 * y * y) + p2 * mixed
        return np.stack([self.K[0, 0] * u + self.K[0, 2], self.K[1, 1] * v + self.K[1, 2]], axis=1)

    def _radial(self, square: Floats) -> tuple[Floats, Floats]:
        """Return the factor of the radial distortion, and its derivative by the squared radius."""
        k1, k2, _, _, k3 = self.distortion[:5]
        radial, derivative = _cubic((k1, k2, k3), square)
        if len(self.distortion) > 5:
            divisor, divisor_derivative = _cubic(self.distortion[5:], square)
            radial = radial / divisor
            derivative = (derivative - radial * divisor_derivative) / divisor
        return radial, derivative

    def ray_jacobian(self, rays: Floats, along: Literal['u', 'v']) -> Floats:
        """
        Return the derivative of rays by a pixel coordinate.

        rays : (n, 3) of unit depth, as ``rays`` returns them
        along : the pixel coordinate
        returns : (n, 3) float64, d(x, y, 1)/du or /dv
        """
        x, y = rays[:, 0], rays[:, 1]
        p1, p2 = self.distortion[2:4]
        radial, derivative = self._radial(x * x + y * y)
        # Jacobian of OpenCV's distortion model; it is symmetric, and inverted in closed form
        mixed = 2.0 * (x * y * derivative + p1 * x + p2 * y)
        by_x = radial + 2.0 * (x * x * derivative + p1 * y + 3.0 * p2 * x)
        by_y = radial + 2.0 * (y * y * derivative + p2 * x + 3.0 * p1 * y)
        first, second = (by_y, -mixed) if along == 'u' else (-mixed, by_x)
        focal = self.K[0, 0] if along == 'u' else self.K[1, 1]
        scale = 1.0 / (focal * (by_x * by_y - mixed * mixed))
        return np.stack([first * scale, second * scale, np.zeros_like(x)], axis=1)

    def require_image_size(self, shape: tuple[int, ...], where: str) -> None:
        """
        Check that an image has the size at which this camera was calibrated.

        shape : (height, width, ...); where : begins the message
        :raises CellError: it has another size
        """
        if shape[:2] != (self.height, self.width):
            raise CellError(
                f'{where}: the picture is {shape[1]} x {shape[0]}, the camera was calibrated '
                f'at {self.width} x {self.height}; use pictures and calibration of one camera'
            )


def complete_distortion(model: str, values: ArrayLike) -> Floats:
    """
    Return distortion coefficients with as many numbers as their model has.

    OpenCV takes vectors of 4, 5, 8, 12 and 14 numbers, in which what is left out is zero.

    :raises CellError: unknown model, another number of coefficients, or one is not zero that the
        model does not have
    """
    require_one_of('distortion_model', model, DISTORTION_COEFFICIENTS, error=CellError)
    given = np.asarray(values, dtype=np.float64).reshape(-1)
    count = DISTORTION_COEFFICIENTS[model]
    name = 'distortion_coefficients'
    if not np.isfinite(given).all() or len(given) not in _OPENCV_COUNTS:
        raise CellError(f'{name}: {model} has {count} finite numbers, there are {len(given)}')
    if given[count:].any():
        raise CellError(
            f'{name}: {model} has {count} numbers; there are {len(given)}, of which '
            f'{", ".join(f"{value:g}" for value in given[count:])} must be zero'
        )
    return np.concatenate([given, np.zeros(count)])[:count]


def _cubic(k: Sequence[float] | Floats, square: Floats) -> tuple[Floats, Floats]:
    """Return 1 + k0 s + k1 s^2 + k2 s^3 and its derivative by s."""
    value = 1.0 + square * (k[0] + square * (k[1] + square * k[2]))
    return value, k[0] + square * (2.0 * k[1] + 3.0 * square * k[2])


def _undistort(pixels: Floats, K: Floats, distortion: Floats) -> Any:
    # OpenCV 4 takes termination criteria in a separate function, OpenCV 5 in undistortPoints
    if hasattr(cv2, 'undistortPointsIter'):
        return cv2.undistortPointsIter(pixels, K, distortion, None, None, _TERMINATION)
    return cv2.undistortPoints(pixels, K, distortion, criteria=_TERMINATION)
