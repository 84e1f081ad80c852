# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The estimators that others use, to compare with and for cells where they do better.

Naidu and Fisher 1991 (A Comparative Analysis of Algorithms for Determining the Peak Position of
a Stripe to Sub-pixel Accuracy) compare most of them.
"""

import numpy as np
from scipy.special import ndtr

from ivfmc_ros.model import Singles
from ivfmc_ros.stripe.estimators import symmetric
from ivfmc_ros.stripe.estimators.patches import Estimate
from ivfmc_ros.stripe.estimators.patches import of_rough
from ivfmc_ros.stripe.estimators.patches import Patches
from ivfmc_ros.stripe.noise import Noise

_RECENTRINGS = 3
_NEWTON_STEPS = 4
_REWEIGHTINGS = 3
# Half the window of the centre of mass, in sigmas of the stripe: less noise than a wider one.
_MASS_WINDOW = 2.2
# A logarithm is taken of pixels that are this many sigmas of noise above the ground.
_ABOVE_NOISE = 2.0


def brightest(patches: Patches, noise: Noise) -> Estimate:
    """Return the brightest pixel, or the middle of those that are equally bright (the paper)."""
    values = np.where(patches.used > 0, patches.values, -1.0)
    top = values == values.max(axis=1, keepdims=True)
    place = (top * patches.x).sum(axis=1) / top.sum(axis=1)
    # pixels whose loss of brightness is within the noise are as likely
    height = patches.rough.height.astype(np.float64)
    grain = np.sqrt(noise.variance(patches.rough.level + height, height)) / height
    reach = patches.rough.width * np.sqrt(2.0 * np.sqrt(2.0) * grain)
    return of_rough(patches, noise, place, np.sqrt(reach**2 / 3.0 + 1.0 / 12.0))


def centre_of_mass(patches: Patches, noise: Noise) -> Estimate:
    """Return the centre of mass in a window that is moved until it is centred on it."""
    signal = _signal(patches)
    half = (_MASS_WINDOW * patches.rough.width)[:, None]
    centre = _start(patches)[:, None]
    with np.errstate(divide='ignore', invalid='ignore'):
        for _ in range(_RECENTRINGS):
            # pixels on the window's rim count in part, or the result would lock to whole pixels
            weight = np.clip(half - np.abs(patches.x - centre) + 0.5, 0.0, 1.0)
            mass = weight * signal
            total = mass.sum(axis=1, keepdims=True)
            centre = (mass * patches.x).sum(axis=1, keepdims=True) / total
        variance = noise.variance(patches.values, signal)
        spread = (weight * (patches.x - centre)) ** 2 * variance
        sigma = np.sqrt(spread.sum(axis=1)) / total[:, 0] / _follow(_MASS_WINDOW)
    return of_rough(patches, noise, centre[:, 0], sigma)


def zero_crossing(patches: Patches, noise: Noise) -> Estimate:
    """
    Return where the row, filtered by the derivative of a Gaussian, crosses zero.

    The filter is as wide as the stripe (the scale at which Steger 1998 finds lines), and its
    zero is found by Newton's method instead of between two pixels.
    """
    signal = _signal(patches) * patches.used
    width = np.maximum(patches.rough.width, 0.7)[:, None]
    centre = _start(patches)[:, None]
    with np.errstate(divide='ignore', invalid='ignore'):
        for _ in range(_NEWTON_STEPS):
            t = (patches.x - centre) / width
            bell = np.exp(-0.5 * t * t)
            slope = (signal * bell * (1.0 - t * t)).sum(axis=1, keepdims=True)
            step = (signal * bell * t).sum(axis=1, keepdims=True) / slope * width
            centre = centre + np.clip(step, -width, width)
        variance = noise.variance(patches.values, signal)
        spread = np.sqrt(((bell * t * patches.used) ** 2 * variance).sum(axis=1))
        sigma = spread * width[:, 0] / slope[:, 0]
    return of_rough(patches, noise, centre[:, 0], np.where(sigma > 0, sigma, np.nan))


def log_gaussian(patches: Patches, noise: Noise) -> Estimate:
    """Return the vertex of a parabola through the logarithms, weighted by their noise."""
    signal = _signal(patches)
    powers = np.vander(patches.x, 5, increasing=True).astype(np.float32)
    least = _ABOVE_NOISE * np.sqrt(noise.variance(patches.values, np.zeros_like(signal)))
    used = patches.used * (signal > least)
    logarithm = np.log(np.maximum(signal, 1.0))
    bell = signal
    with np.errstate(divide='ignore', invalid='ignore'):
        for _ in range(_REWEIGHTINGS):
            weight = used * bell**2 / noise.variance(patches.values, bell)
            squares = (weight @ powers).T.astype(np.float64)
            pull = ((weight * logarithm) @ powers[:, :3]).T.astype(np.float64)
            covariance = symmetric.inverse(squares[symmetric.SUM])
            c = symmetric.times(covariance, pull)
            # the next weights by the fitted bell, which is not dark by chance (Guo 2011)
            bell = np.exp(np.minimum((c.T.astype(np.float32) @ powers[:, :3].T), 12.0))
        c2 = np.where(c[2] < 0, c[2], np.nan)
        gradient = np.stack([np.zeros_like(c2), -0.5 / c2, 0.5 * c[1] / c2**2])
        sigma = symmetric.spread(covariance, gradient)
    return of_rough(patches, noise, -0.5 * c[1] / c2, sigma)


def _signal(patches: Patches) -> Singles:
    """Return what rises above the ground, (n, w)."""
    return np.asarray(patches.values - patches.rough.level[:, None])


def _start(patches: Patches) -> Singles:
    rough = patches.rough
    return np.asarray((rough.column - patches.column) + rough.middle, dtype=np.float32)


def _follow(window: float) -> float:
    """Return which share of an offset of the window its centre of mass takes back."""
    density = np.exp(-0.5 * window**2) / np.sqrt(2.0 * np.pi)
    inside = 1.0 - 2.0 * ndtr(-window)
    return float(1.0 - 2.0 * window * density / inside)
