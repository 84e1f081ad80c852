# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Noise model of a camera pixel: read noise, shot noise and laser speckle."""

from dataclasses import dataclass
import math
from typing import TypeVar

import numpy as np

from ivfmc_ros.model import Floats
from ivfmc_ros.model import Singles
from ivfmc_ros.validation import require_in_range

Values = TypeVar('Values', Floats, Singles)

# DN^2, minimum variance: quantization to whole gray values.
_QUANTIZATION = 1.0 / 12.0


@dataclass(frozen=True, kw_only=True)
class SensorNoise:
    """
    Noise model of a pixel: variance = read^2 + I / electrons_per_dn + (speckle I_laser)^2.

    read : DN, read noise (1 sigma), quantization included
    electrons_per_dn : electrons per gray value (shot noise); inf for no shot noise
    speckle : contrast of the laser speckle, standard deviation as a fraction of the signal
    """

    read: float = 2.0
    electrons_per_dn: float = 45.0
    speckle: float = 0.15

    def __post_init__(self) -> None:
        require_in_range('read', self.read, 0.0, 100.0, 'DN')
        require_in_range('electrons_per_dn', self.electrons_per_dn, 0.0, math.inf, open_low=True)
        require_in_range('speckle', self.speckle, 0.0, 2.0)

    def variance(self, total: Values, laser: Values) -> Values:
        """
        Return the variance of pixels in DN^2, with the shape and dtype of ``total``.

        total : gray values (DN)
        laser : contribution of the laser to ``total`` (DN)
        """
        variance = self.speckle * laser
        variance *= variance
        variance += max(self.read**2, _QUANTIZATION)
        if math.isfinite(self.electrons_per_dn):
            variance += np.maximum(total, 0.0) * (1.0 / self.electrons_per_dn)
        return variance
