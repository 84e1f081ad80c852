# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The laser stripe of one image: sub-pixel positions with width and uncertainty."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints


@dataclass(frozen=True, eq=False, kw_only=True)
class Stripe:
    """
    The stripe of one image, one entry for each row (or column) where it was found.

    uv : (n, 2) float64, pixels (column, row)
    intensity : (n,) float64, height above the background, gray values of 0 to 255
    width : (n,) float64, pixels, sigma of the stripe's profile
    sigma : (n,) float64, pixels, 1 sigma of the position: pixel noise and, if enabled, the
        uncertainty due to a profile that is not Gaussian
    """

    uv: Floats
    intensity: Floats
    width: Floats
    sigma: Floats

    @classmethod
    def concatenated(cls, parts: Sequence['Stripe']) -> 'Stripe':
        """Return the entries of several images as one."""
        none = np.zeros(0)

        def joined(name: str) -> Floats:
            return np.concatenate([none, *(getattr(part, name) for part in parts)])

        uv = np.concatenate([np.zeros((0, 2)), *(part.uv for part in parts)])
        return cls(
            uv=uv, intensity=joined('intensity'), width=joined('width'), sigma=joined('sigma')
        )

    def __len__(self) -> int:
        return len(self.uv)

    def __getitem__(self, chosen: Bools | Ints) -> 'Stripe':
        return Stripe(
            uv=self.uv[chosen],
            intensity=self.intensity[chosen],
            width=self.width[chosen],
            sigma=self.sigma[chosen],
        )
