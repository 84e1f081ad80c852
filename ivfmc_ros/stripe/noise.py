# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How noisy a pixel is."""

from dataclasses import dataclass
import math
from typing import TypeVar

import numpy as np

from ivfmc_ros.model import Floats
from ivfmc_ros.model import Singles
from ivfmc_ros.validation import require_in_range

Values = TypeVar('Values', Floats, Singles)

# Least variance: a grey value is a whole number.
_ROUNDING = 1.0 / 12.0


@dataclass(frozen=True, kw_only=True)
class Noise:
    """
    Variance of a pixel: read^2 + I / electrons_per_dn + (speckle I_laser)^2.

    read : read noise in grey values, rounding to whole ones included
    electrons_per_dn : electrons that raise a pixel by one grey value (shot noise); may be inf
    speckle : contrast of the laser's speckle as the camera sees it, a share of the signal
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
        Return the variance of pixels, in squared grey values, in the type of ``total``.

        total : grey values as read
        laser : the part of it that the laser gave
        """
        variance = self.speckle * laser
        variance *= variance
        variance += max(self.read**2, _ROUNDING)
        if math.isfinite(self.electrons_per_dn):
            variance += np.maximum(total, 0.0) * (1.0 / self.electrons_per_dn)
        return variance
