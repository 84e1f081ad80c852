# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Estimation of the stripe position from the top of the peak only, for translucent materials.

Subsurface scattering (wax, plastic, skin) adds broad, asymmetric tails to the stripe, which bias
every estimate that uses them. The top of the peak is dominated by light from the surface itself.
"""

import numpy as np

from ivfmc_ros.model import Bools
from ivfmc_ros.stripe.estimators.patches import estimate_from_peaks
from ivfmc_ros.stripe.estimators.patches import Patches
from ivfmc_ros.stripe.estimators.patches import PeakEstimate
from ivfmc_ros.stripe.noise import SensorNoise

# Fraction of the height above which pixels are used.
_MIN_HEIGHT_FRACTION = 0.6


def top_of_peak(patches: Patches, noise: SensorNoise) -> PeakEstimate:
    """Return the center of mass of the gray values above a fraction of the peak's height."""
    signal = patches.values - patches.rough.level[:, None]
    above_cut = signal - _MIN_HEIGHT_FRACTION * patches.rough.height[:, None]
    mass = np.where(_connected_to_peak(patches, above_cut > 0.0), above_cut, 0.0).astype(
        np.float64
    )
    total = mass.sum(axis=1)
    with np.errstate(divide='ignore', invalid='ignore'):
        position = (mass * patches.x).sum(axis=1) / total
        lever = np.where(mass > 0.0, patches.x - position[:, None], 0.0)
        variance = noise.variance(patches.values, signal)
        sigma = np.sqrt((lever**2 * variance).sum(axis=1)) / total
    return estimate_from_peaks(patches, noise, position, sigma)


def _connected_to_peak(patches: Patches, above: Bools) -> Bools:
    """Return the run of pixels above the cut that contains the detected peak, (n, w) bool."""
    start = np.rint(patches.rough.column + patches.rough.middle - patches.column)
    start = np.clip(start.astype(np.int64) + above.shape[1] // 2, 0, above.shape[1] - 1)
    index = np.arange(above.shape[1])
    boundary = np.where(above, -1, index)
    left = np.where(index <= start[:, None], boundary, -1).max(axis=1)
    boundary = np.where(above, above.shape[1], index)
    right = np.where(index >= start[:, None], boundary, above.shape[1]).min(axis=1)
    return np.asarray((index > left[:, None]) & (index < right[:, None]))
