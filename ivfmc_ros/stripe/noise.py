# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How noisy a pixel is."""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.model import Floats


@dataclass(frozen=True, kw_only=True)
class Noise:
    """
    Variance of a pixel: read^2 + I / electrons_per_dn + (speckle I_laser)^2.

    read : read noise in grey values
    electrons_per_dn : electrons that raise a pixel by one grey value (shot noise)
    speckle : contrast of the laser's speckle as the camera sees it, a share of the signal
    """

    read: float = 2.0
    electrons_per_dn: float = 45.0
    speckle: float = 0.15

    def variance(self, total: Floats, laser: Floats) -> Floats:
        """
        Return the variance of pixels, in squared grey values.

        total : grey values as read
        laser : the part of it that the laser gave
        """
        shot = np.maximum(total, 0.0) / self.electrons_per_dn
        return np.asarray(self.read**2 + shot + (self.speckle * laser) ** 2)
