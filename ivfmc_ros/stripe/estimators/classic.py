# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Classic estimators of the stripe position: brightest pixel, center of mass and others.

Naidu and Fisher 1991 (A Comparative Analysis of Algorithms for Determining the Peak Position of
a Stripe to Sub-pixel Accuracy) compare most of them.
"""

import numpy as np
from scipy.special import ndtr

from ivfmc_ros.model import Singles
from ivfmc_ros.stripe.estimators import symmetric
from ivfmc_ros.stripe.estimators.patches import estimate_from_peaks
from ivfmc_ros.stripe.estimators.patches import Patches
from ivfmc_ros.stripe.estimators.patches import PeakEstimate
from ivfmc_ros.stripe.noise import SensorNoise

# Iterations of each estimator; more change positions by less than their noise.
_RECENTERINGS = 3
_NEWTON_STEPS = 4
_REWEIGHTINGS = 3
# Half width of the window of the center of mass, in sigmas of the stripe: a wider one adds noise.
_MASS_WINDOW = 2.2
# Pixels used for the logarithm: above the background by this many sigmas of noise.
_MIN_SNR = 2.0


def brightest_pixel(patches: Patches, noise: SensorNoise) -> PeakEstimate:
    """Return the brightest pixel, or the mean of equally bright ones (Ismail et al. 2007)."""
    values = np.where(patches.used > 0, patches.values, -1.0)
    top = values == values.max(axis=1, keepdims=True)
    position = (top * patches.x).sum(axis=1) / top.sum(axis=1)
    # any pixel whose loss of brightness is within the noise can be the brightest one
    height = patches.rough.height.astype(np.float64)
    relative_noise = np.sqrt(noise.variance(patches.rough.level + height, height)) / height
    half_width = patches.rough.width * np.sqrt(2.0 * np.sqrt(2.0) * relative_noise)
    return estimate_from_peaks(patches, noise, position, np.sqrt(half_width**2 / 3.0 + 1.0 / 12.0))


def center_of_mass(patches: Patches, noise: SensorNoise) -> PeakEstimate:
    """Return the center of mass in a window that is iteratively centered on it."""
    signal = _signal(patches)
    half = (_MASS_WINDOW * patches.rough.width)[:, None]
    center = _start(patches)[:, None]
    with np.errstate(divide='ignore', invalid='ignore'):
        for _ in range(_RECENTERINGS):
            # partial weight at the border of the window avoids locking to whole pixels
            weight = np.clip(half - np.abs(patches.x - center) + 0.5, 0.0, 1.0)
            mass = weight * signal
            total = mass.sum(axis=1, keepdims=True)
            center = (mass * patches.x).sum(axis=1, keepdims=True) / total
        variance = noise.variance(patches.values, signal)
        spread = (weight * (patches.x - center)) ** 2 * variance
        sigma = np.sqrt(spread.sum(axis=1)) / total[:, 0] / _window_response(_MASS_WINDOW)
    return estimate_from_peaks(patches, noise, center[:, 0], sigma)


def zero_crossing(patches: Patches, noise: SensorNoise) -> PeakEstimate:
    """
    Return the zero crossing of the row filtered by the derivative of a Gaussian.

    The filter has the width of the stripe (cf. Steger 1998, An Unbiased Detector of Curvilinear
    Structures); the zero is found by Newton's method instead of interpolation.
    """
    signal = _signal(patches) * patches.used
    width = np.maximum(patches.rough.width, 0.7)[:, None]
    center = _start(patches)[:, None]
    with np.errstate(divide='ignore', invalid='ignore'):
        for _ in range(_NEWTON_STEPS):
            t = (patches.x - center) / width
            bell = np.exp(-0.5 * t * t)
            slope = (signal * bell * (1.0 - t * t)).sum(axis=1, keepdims=True)
            step = (signal * bell * t).sum(axis=1, keepdims=True) / slope * width
            center = center + np.clip(step, -width, width)
        variance = noise.variance(patches.values, signal)
        spread = np.sqrt(((bell * t * patches.used) ** 2 * variance).sum(axis=1))
        sigma = spread * width[:, 0] / slope[:, 0]
    return estimate_from_peaks(patches, noise, center[:, 0], np.where(sigma > 0, sigma, np.nan))


def log_gaussian(patches: Patches, noise: SensorNoise) -> PeakEstimate:
    """Return the vertex of a weighted parabola through the logarithms (Guo 2011)."""
    signal = _signal(patches)
    powers = np.vander(patches.x, 5, increasing=True).astype(np.float32)
    least = _MIN_SNR * np.sqrt(noise.variance(patches.values, np.zeros_like(signal)))
    used = patches.used * (signal > least)
    logarithm = np.log(np.maximum(signal, 1.0))
    bell = signal
    with np.errstate(divide='ignore', invalid='ignore'):
        for _ in range(_REWEIGHTINGS):
            weight = used * bell**2 / noise.variance(patches.values, bell)
            squares = (weight @ powers).T.astype(np.float64)
            rhs = ((weight * logarithm) @ powers[:, :3]).T.astype(np.float64)
            covariance = symmetric.inverse(squares[symmetric.SUM])
            c = symmetric.multiply(covariance, rhs)
            # weights from the fitted Gaussian instead of the noisy pixels (Guo 2011)
            bell = np.exp(np.minimum((c.T.astype(np.float32) @ powers[:, :3].T), 12.0))
        c2 = np.where(c[2] < 0, c[2], np.nan)
        gradient = np.stack([np.zeros_like(c2), -0.5 / c2, 0.5 * c[1] / c2**2])
        sigma = symmetric.propagated_sigma(covariance, gradient)
    return estimate_from_peaks(patches, noise, -0.5 * c[1] / c2, sigma)


def _signal(patches: Patches) -> Singles:
    """Return gray values above the background, (n, w)."""
    return np.asarray(patches.values - patches.rough.level[:, None])


def _start(patches: Patches) -> Singles:
    rough = patches.rough
    return np.asarray((rough.column - patches.column) + rough.middle, dtype=np.float32)


def _window_response(window: float) -> float:
    """Return by which fraction of an offset the center of mass in a window follows the stripe."""
    density = np.exp(-0.5 * window**2) / np.sqrt(2.0 * np.pi)
    inside = 1.0 - 2.0 * ndtr(-window)
    return float(1.0 - 2.0 * window * density / inside)
