# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is found in one picture."""

from dataclasses import dataclass

from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints


@dataclass(frozen=True, eq=False, kw_only=True)
class Stripe:
    """
    The stripe of one picture, one entry for each row (or column) where it was found.

    uv : (n, 2) float64, pixel (column, row)
    intensity : (n,) float64, height above the background in grey values of 0 to 255
    width : (n,) float64, sigma of the stripe in pixels
    sigma : (n,) float64, 1 sigma of the position in pixels, from the noise of the pixels and,
        where the profile is not a stripe's, from how far it can have pulled the position
    """

    uv: Floats
    intensity: Floats
    width: Floats
    sigma: Floats

    def __len__(self) -> int:
        return len(self.uv)

    def __getitem__(self, chosen: Bools | Ints) -> 'Stripe':
        return Stripe(
            uv=self.uv[chosen],
            intensity=self.intensity[chosen],
            width=self.width[chosen],
            sigma=self.sigma[chosen],
        )
