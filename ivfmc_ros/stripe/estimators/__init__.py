# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Ways to tell where in a row the middle of the stripe is, behind one interface."""

from collections.abc import Callable

from ivfmc_ros.stripe.estimators import classic
from ivfmc_ros.stripe.estimators import gaussian
from ivfmc_ros.stripe.estimators.patches import Estimate
from ivfmc_ros.stripe.estimators.patches import Patches
from ivfmc_ros.stripe.estimators.peak_top import top_of_peak
from ivfmc_ros.stripe.noise import Noise

Estimator = Callable[[Patches, Noise], Estimate]

DEFAULT = 'gaussian'

# Their sigma is a share of the stripe's width wherever it is, not a matter of the picture: no
# point is better than others, and no limit could leave the worse ones out.
BLUNT = ('paper',)

METHODS: dict[str, Estimator] = {
    'paper': classic.brightest,
    'centre_of_mass': classic.centre_of_mass,
    'zero_crossing': classic.zero_crossing,
    'log_gaussian': classic.log_gaussian,
    'top_of_peak': top_of_peak,
    DEFAULT: gaussian.fit,
}
