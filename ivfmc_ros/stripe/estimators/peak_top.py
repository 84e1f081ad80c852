# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The place of the stripe from the top of its peak alone.

Wax, plastic and skin glow: light enters beside the stripe and comes out as broad skirts, on one
side more than on the other, which draw every estimate that looks at them. The top of the peak is
light that came back from the surface.
"""

import numpy as np

from ivfmc_ros.model import Bools
from ivfmc_ros.stripe.estimators.patches import Estimate
from ivfmc_ros.stripe.estimators.patches import of_rough
from ivfmc_ros.stripe.estimators.patches import Patches
from ivfmc_ros.stripe.noise import Noise

# What counts of the peak: all above this share of its height.
_CUT = 0.6


def top_of_peak(patches: Patches, noise: Noise) -> Estimate:
    """Return the centre of mass of what rises above a share of the peak's height."""
    signal = patches.values - patches.rough.level[:, None]
    rise = signal - _CUT * patches.rough.height[:, None]
    mass = np.where(_around_peak(patches, rise > 0.0), rise, 0.0).astype(np.float64)
    total = mass.sum(axis=1)
    with np.errstate(divide='ignore', invalid='ignore'):
        place = (mass * patches.x).sum(axis=1) / total
        lever = np.where(mass > 0.0, patches.x - place[:, None], 0.0)
        variance = noise.variance(patches.values, signal)
        sigma = np.sqrt((lever**2 * variance).sum(axis=1)) / total
    return of_rough(patches, noise, place, sigma)


def _around_peak(patches: Patches, above: Bools) -> Bools:
    """Return the unbroken run of pixels above the cut that holds the rough peak, (n, w)."""
    start = np.rint(patches.rough.column + patches.rough.middle - patches.column)
    start = np.clip(start.astype(np.int64) + above.shape[1] // 2, 0, above.shape[1] - 1)
    index = np.arange(above.shape[1])
    gap = np.where(above, -1, index)
    left = np.where(index <= start[:, None], gap, -1).max(axis=1)
    gap = np.where(above, above.shape[1], index)
    right = np.where(index >= start[:, None], gap, above.shape[1]).min(axis=1)
    return np.asarray((index > left[:, None]) & (index < right[:, None]))
