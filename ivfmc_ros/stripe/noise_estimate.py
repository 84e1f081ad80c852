# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Estimation of a camera's noise model (read noise, shot noise, speckle) from stripe images.

The residuals of the fitted stripe are regressed on the brightness: a photon transfer curve
(Janesick 2007, Photon Transfer) with an additional speckle term. No series of equal images is
needed, because speckle is independent from row to row.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import fields
import math

import numpy as np
from scipy.optimize import nnls

from ivfmc_ros.errors import CalibrationError
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Image
from ivfmc_ros.model import Ints
from ivfmc_ros.stripe.cropped_image import CroppedImage
from ivfmc_ros.stripe.estimators.gaussian import Residuals
from ivfmc_ros.stripe.estimators.gaussian import residuals
from ivfmc_ros.stripe.extract import stripe_patches
from ivfmc_ros.stripe.noise import SensorNoise
from ivfmc_ros.stripe.settings import ExtractSettings

# Reweighting iterations: the fit needs the noise model that is estimated from its residuals.
_ITERATIONS = 4
# Residuals that an estimate needs.
_MIN_PIXELS = 500
# Bins of the common deviation from a Gaussian: width in sigmas of the stripe, number to each side.
_SHAPE_STEP = 0.2
_SHAPE_STEPS = 20
# Upper limit of the speckle contrast; larger values come from a profile that is not Gaussian.
_MAX_SPECKLE = 0.3
# Bins of the photon transfer curve: by laser light, and each of them by total brightness.
_LASER_GROUPS, _TOTAL_GROUPS = 24, 3
# Median of the absolute value of a standard normal variable.
_NORMAL_MEDIAN = 0.6745
# Squared relative error of a variance estimated by a median, times the number of values (2 for
# the mean of squares).
_MEDIAN_VARIANCE = 5.44


@dataclass(frozen=True, kw_only=True)
class NoiseEstimate:
    """
    An estimated noise model and its standard errors.

    read_error, shot_error, speckle_error : standard errors of read^2 (DN^2),
        1 / electrons_per_dn (DN) and speckle^2
    shape : rms deviation of the stripe's profile from a Gaussian, fraction of its height
    pixels : number of pixels used
    """

    noise: SensorNoise
    read_error: float
    shot_error: float
    speckle_error: float
    shape: float
    pixels: int


def estimate_noise(grays: Sequence[Image], settings: ExtractSettings) -> NoiseEstimate:
    """
    Estimate the noise model of a camera from images that show the stripe.

    grays : (h, w) each, uint8 or uint16, one stripe point per row
    :raises CalibrationError: the images show too few pixels of a stripe
    """
    patches = [
        patches
        for gray in grays
        for _, patches in stripe_patches(CroppedImage.of(gray, 'rows', settings), settings)
    ]
    noise = SensorNoise()
    for _ in range(_ITERATIONS):
        parts = [residuals(part, noise) for part in patches]
        count = sum(len(part.residual) for part in parts)
        if count < _MIN_PIXELS:
            raise CalibrationError(
                f'noise: {count} pixels of a stripe in {len(grays)} images, at least '
                f'{_MIN_PIXELS} are needed; use images with the laser on'
            )
        pooled = _concatenated(parts)
        noise, errors, shape = _regress(pooled, noise)
    return NoiseEstimate(
        noise=noise,
        read_error=errors[0],
        shot_error=errors[1],
        speckle_error=errors[2],
        shape=shape,
        pixels=count,
    )


def _concatenated(parts: Sequence[Residuals]) -> Residuals:
    names = [field.name for field in fields(Residuals)]
    arrays = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    return Residuals(**arrays)


def _shape(pooled: Residuals, variance: Floats) -> Floats:
    """
    Return the common deviation of all stripes from a Gaussian at each pixel, fraction of height.

    Lens blur, a tone curve or sharpening in the camera cause it; it is systematic, not noise.
    """
    position = np.clip(np.rint(pooled.position / _SHAPE_STEP), -_SHAPE_STEPS, _SHAPE_STEPS)
    position = (position + _SHAPE_STEPS).astype(np.int64)
    rhs = np.bincount(position, pooled.residual * pooled.height / variance, 2 * _SHAPE_STEPS + 1)
    power = np.bincount(position, pooled.height**2 / variance, 2 * _SHAPE_STEPS + 1)
    return np.asarray((rhs / np.maximum(power, 1e-9))[position])


def _groups(pooled: Residuals) -> list[Ints]:
    """Bin pixels by laser light and, within each bin, by total brightness."""
    by_laser = np.array_split(np.argsort(pooled.laser), _LASER_GROUPS)
    return [
        group
        for part in by_laser
        for group in np.array_split(part[np.argsort(pooled.total[part])], _TOTAL_GROUPS)
    ]


def _regress(pooled: Residuals, noise: SensorNoise) -> tuple[SensorNoise, list[float], float]:
    """Fit read^2, 1 / electrons_per_dn and speckle^2 by non-negative least squares."""
    variance = noise.variance(pooled.total, pooled.laser)
    shape = _shape(pooled, variance)
    random = np.abs(pooled.residual - pooled.height * shape)
    rows = []
    for group in _groups(pooled):
        # the median is robust against texture and edges, which affect a minority of pixels
        seen = (np.median(random[group]) / _NORMAL_MEDIAN) ** 2
        mean_total, square = np.maximum(pooled.total[group], 0.0).mean(), pooled.laser[group] ** 2
        error = variance[group].mean() * math.sqrt(_MEDIAN_VARIANCE / len(group))
        rows.append(np.array([1.0, mean_total, square.mean(), seen]) / error)
    table = np.stack(rows)
    weighted, seen = table[:, :3], table[:, 3]
    normal = weighted.T @ weighted
    size = np.sqrt(np.diag(normal))
    rhs = weighted.T @ seen / size
    cholesky = np.linalg.cholesky(normal / np.outer(size, size) + 1e-9 * np.eye(3))
    scaled, _ = nnls(cholesky.T, np.linalg.solve(cholesky, rhs))
    read, shot, speckle = (float(value) for value in scaled / size)
    return (
        SensorNoise(
            read=min(math.sqrt(read), 100.0),
            electrons_per_dn=1.0 / shot if shot > 1e-6 else math.inf,
            speckle=min(math.sqrt(speckle), _MAX_SPECKLE),
        ),
        _errors(normal),
        float(np.sqrt(np.mean(shape**2))),
    )


def _errors(normal: Floats) -> list[float]:
    return [float(value) for value in np.sqrt(np.diag(np.linalg.pinv(normal)))]
