# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How good the stripe in an image is, and what the operator can do about it."""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.model import Floats
from ivfmc_ros.model import Image

# Gray value, share of full scale, from which a pixel counts as saturated (JPEG alters it a bit).
_SATURATED = 0.98
# Height of the stripe, share of full scale, below which it is weak.
_WEAK = 0.06
# Points with more than so many times the median standard deviation are uncertain.
_UNCERTAIN = 3.0
# Shares from which the advice changes.
_MUCH_SATURATED, _MUCH_WEAK, _MUCH_MISSING = 0.1, 0.3, 0.4


@dataclass(frozen=True, kw_only=True)
class StripeShares:
    """
    Shares of the rows between the first and the last one of the stripe, 0 to 1.

    rows : number of these rows
    missing : without a point; saturated, weak, uncertain : of a point that is so
    """

    rows: int
    saturated: float = 0.0
    weak: float = 0.0
    missing: float = 0.0
    uncertain: float = 0.0

    @property
    def advice(self) -> str:
        """What to change, '' where the stripe is good."""
        if not self.rows:
            return 'no stripe: is the laser on, and the part in the light sheet?'
        if self.saturated > _MUCH_SATURATED:
            return f'lower the exposure: {self.saturated:.0%} of the stripe is saturated'
        if self.weak > _MUCH_WEAK:
            return f'raise the exposure or the laser power: {self.weak:.0%} of the stripe is weak'
        if self.missing > _MUCH_MISSING:
            return (
                f'{self.missing:.0%} of the rows have no point: shiny, dark or hidden surface; '
                'see the page on dark and shiny parts'
            )
        return ''


def stripe_shares(image: Image, uv: Floats, intensity: Floats, sigma: Floats) -> StripeShares:
    """
    Judge the stripe of an image.

    image : (height, width) or (height, width, 3), the picture of the profile
    uv, intensity, sigma : (n, 2) pixels, (n,) DN, (n,) meters of its points; stripes that cross
        the rows and those that cross the columns are told apart by their extent
    """
    if not len(uv):
        return StripeShares(rows=0)
    gray = image if image.ndim == 2 else image.max(axis=2)
    full = float(np.iinfo(gray.dtype).max)
    column, row = np.round(uv).astype(int).T
    peak = gray[np.clip(row, 0, gray.shape[0] - 1), np.clip(column, 0, gray.shape[1] - 1)]
    along = row if np.ptp(row) >= np.ptp(column) else column
    rows = int(np.ptp(along)) + 1
    typical = float(np.median(sigma))
    return StripeShares(
        rows=rows,
        saturated=float(np.mean(peak >= _SATURATED * full)),
        weak=float(np.mean(intensity < _WEAK * full)),
        missing=1.0 - min(1.0, len(np.unique(along)) / rows),
        uncertain=float(np.mean(sigma > _UNCERTAIN * typical)) if typical > 0.0 else 0.0,
    )
