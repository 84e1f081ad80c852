# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The noise of a camera, from pictures of the stripe.

What a fitted stripe leaves of its pixels is noise, for a dark ground, a bright ground and all
brightnesses of the laser at once: a photon transfer curve (Janesick 2007) with a term for
speckle, which needs no series of equal pictures, and in which speckle is new in every row.
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
from ivfmc_ros.stripe.estimators.gaussian import Residuals
from ivfmc_ros.stripe.estimators.gaussian import residuals
from ivfmc_ros.stripe.extract import stripe_patches
from ivfmc_ros.stripe.noise import Noise
from ivfmc_ros.stripe.roi import Part
from ivfmc_ros.stripe.settings import ExtractSettings

_ROUNDS = 4
_MIN_PIXELS = 500
# The common shape of stripes is told at places of so many sigmas, to both sides.
_SHAPE_STEP = 0.2
_SHAPE_STEPS = 20
# More is no speckle (a single grain has contrast 1), but a stripe that is no bell.
_MOST_SPECKLE = 0.3
_LASER_GROUPS, _TOTAL_GROUPS = 24, 3
_NORMAL_MEDIAN = 0.6745
# Squared relative error of a variance told by a median, times the number of values (2 for a sum).
_MEDIAN_VARIANCE = 5.44


@dataclass(frozen=True, kw_only=True)
class NoiseEstimate:
    """
    A noise model and how well the pictures tell it.

    read_error, shot_error, speckle_error : standard errors of read^2 (DN^2),
        1 / electrons_per_dn (DN) and speckle^2
    shape : rms share of the height by which stripes differ from a bell
    pixels : that were used
    """

    noise: Noise
    read_error: float
    shot_error: float
    speckle_error: float
    shape: float
    pixels: int


def estimate_noise(greys: Sequence[Image], settings: ExtractSettings) -> NoiseEstimate:
    """
    Estimate the noise of a camera from pictures that show the stripe.

    greys : (h, w) each, one stripe point a row

    :raises CalibrationError: the pictures show too little of a stripe
    """
    patches = [
        patches
        for grey in greys
        for _, patches in stripe_patches(Part.of(grey, 'rows', settings), settings)
    ]
    noise = Noise()
    for _ in range(_ROUNDS):
        parts = [residuals(part, noise) for part in patches]
        count = sum(len(part.residual) for part in parts)
        if count < _MIN_PIXELS:
            raise CalibrationError(
                f'noise: {count} pixels of a stripe in {len(greys)} pictures, at least '
                f'{_MIN_PIXELS} are needed; use pictures with the laser on'
            )
        left = _joined(parts)
        noise, errors, shape = _regress(left, noise)
    return NoiseEstimate(
        noise=noise,
        read_error=errors[0],
        shot_error=errors[1],
        speckle_error=errors[2],
        shape=shape,
        pixels=count,
    )


def _joined(parts: Sequence[Residuals]) -> Residuals:
    names = [field.name for field in fields(Residuals)]
    arrays = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    return Residuals(**arrays)


def _shape(left: Residuals, variance: Floats) -> Floats:
    """
    Return what all stripes have in common at the place of each pixel, as a share of the height.

    A lens, a tone curve, or a camera that sharpens makes a stripe that is no bell, which is no
    noise.
    """
    place = np.clip(np.rint(left.place / _SHAPE_STEP), -_SHAPE_STEPS, _SHAPE_STEPS)
    place = (place + _SHAPE_STEPS).astype(np.int64)
    pull = np.bincount(place, left.residual * left.height / variance, 2 * _SHAPE_STEPS + 1)
    power = np.bincount(place, left.height**2 / variance, 2 * _SHAPE_STEPS + 1)
    return np.asarray((pull / np.maximum(power, 1e-9))[place])


def _groups(left: Residuals) -> list[Ints]:
    """Sort pixels into groups of like laser light, and in them of like brightness."""
    by_laser = np.array_split(np.argsort(left.laser), _LASER_GROUPS)
    return [
        group
        for part in by_laser
        for group in np.array_split(part[np.argsort(left.total[part])], _TOTAL_GROUPS)
    ]


def _regress(left: Residuals, noise: Noise) -> tuple[Noise, list[float], float]:
    """Fit read^2, 1 / electrons_per_dn and speckle^2, none of them negative."""
    variance = noise.variance(left.total, left.laser)
    shape = _shape(left, variance)
    random = np.abs(left.residual - left.height * shape)
    rows = []
    for group in _groups(left):
        # a median: texture and edges in the picture are no noise, and not in most pixels
        seen = (np.median(random[group]) / _NORMAL_MEDIAN) ** 2
        mean_total, square = np.maximum(left.total[group], 0.0).mean(), left.laser[group] ** 2
        error = variance[group].mean() * math.sqrt(_MEDIAN_VARIANCE / len(group))
        rows.append(np.array([1.0, mean_total, square.mean(), seen]) / error)
    table = np.stack(rows)
    weighted, seen = table[:, :3], table[:, 3]
    normal = weighted.T @ weighted
    size = np.sqrt(np.diag(normal))
    pull = weighted.T @ seen / size
    root = np.linalg.cholesky(normal / np.outer(size, size) + 1e-9 * np.eye(3))
    scaled, _ = nnls(root.T, np.linalg.solve(root, pull))
    read, shot, speckle = (float(value) for value in scaled / size)
    return (
        Noise(
            read=min(math.sqrt(read), 100.0),
            electrons_per_dn=1.0 / shot if shot > 1e-6 else math.inf,
            speckle=min(math.sqrt(speckle), _MOST_SPECKLE),
        ),
        _errors(normal),
        float(np.sqrt(np.mean(shape**2))),
    )


def _errors(normal: Floats) -> list[float]:
    return [float(value) for value in np.sqrt(np.diag(np.linalg.pinv(normal)))]
