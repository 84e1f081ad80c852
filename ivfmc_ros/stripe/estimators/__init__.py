# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Estimators of the sub-pixel stripe position from the pixels of a row, with one interface."""

from collections.abc import Callable

from ivfmc_ros.stripe.estimators import classic
from ivfmc_ros.stripe.estimators import gaussian
from ivfmc_ros.stripe.estimators.patches import Patches
from ivfmc_ros.stripe.estimators.patches import PeakEstimate
from ivfmc_ros.stripe.estimators.peak_top import top_of_peak
from ivfmc_ros.stripe.noise import SensorNoise

Estimator = Callable[[Patches, SensorNoise], PeakEstimate]

DEFAULT = 'gaussian'

# Estimators whose sigma is a fraction of the stripe's width, whatever the pixels: the limit
# ``max_error`` of pixel noise would drop all points or none.
NOISE_INDEPENDENT = ('paper',)

METHODS: dict[str, Estimator] = {
    'paper': classic.brightest_pixel,
    'centre_of_mass': classic.center_of_mass,
    'zero_crossing': classic.zero_crossing,
    'log_gaussian': classic.log_gaussian,
    'top_of_peak': top_of_peak,
    DEFAULT: gaussian.fit,
}
