# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Ways to tell where in a row the middle of the stripe is, behind one interface."""

from collections.abc import Callable

from ivfmc_ros.stripe import gaussian
from ivfmc_ros.stripe.noise import Noise
from ivfmc_ros.stripe.patches import Estimate
from ivfmc_ros.stripe.patches import Patches

Estimator = Callable[[Patches, Noise], Estimate]

METHODS: dict[str, Estimator] = {
    'gaussian': gaussian.fit,
}
