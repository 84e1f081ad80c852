# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Where the stripe is: one sub-pixel position in every row of a picture that shows it.

Peaks that stand out of the noise are found in every row, where a row has several the path along
the stripe decides, and the place of the chosen one is estimated from the pixels around it.
"""

from typing import cast

import cv2
import numpy as np

from ivfmc_ros.cell.laser import Stripe as Direction
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Image
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Singles
from ivfmc_ros.stripe import channel
from ivfmc_ros.stripe import path
from ivfmc_ros.stripe import peaks
from ivfmc_ros.stripe.estimators import METHODS
from ivfmc_ros.stripe.patches import Estimate
from ivfmc_ros.stripe.patches import Patches
from ivfmc_ros.stripe.settings import ExtractSettings
from ivfmc_ros.stripe.stripe import Stripe

__all__ = ['ExtractSettings', 'Stripe', 'extract']

# A smoothed peak must rise by so many sigmas of the picture's noise to be looked at.
_LOOK = 4.0
# A second one in the row must be beyond doubt, for every row has one in its noise.
_LOOK_AGAIN = 7.0
# Rows whose stripe is wider than this many medians are measured apart, in a wider patch.
_USUAL = 1.4


def extract(
    image: Image,
    stripe: Direction = 'rows',
    settings: ExtractSettings | None = None,
    mask: Bools | None = None,
) -> Stripe:
    """
    Find the stripe in a picture.

    image : (h, w) mono or (h, w, 3) BGR, uint8 or uint16
    stripe : 'rows' for one point in every row, 'columns' for one in every column
    mask : (h, w) bool, where the stripe can be; None for everywhere
    returns : without rows that have no stripe, or one that the picture's border cuts
    """
    settings = settings or ExtractSettings()
    if stripe == 'columns':
        image = cast(Image, cv2.transpose(image))
        mask = None if mask is None else np.ascontiguousarray(mask.T)
    grey = channel.to_grey(image, settings.channel)
    found = _extract_rows(grey, settings, mask)
    return _swapped(found) if stripe == 'columns' else found


def _swapped(stripe: Stripe) -> Stripe:
    return Stripe(
        uv=np.ascontiguousarray(stripe.uv[:, ::-1]),
        intensity=stripe.intensity,
        width=stripe.width,
        sigma=stripe.sigma,
    )


def _extract_rows(grey: Image, settings: ExtractSettings, mask: Bools | None) -> Stripe:
    scale = 255.0 / np.iinfo(grey.dtype).max
    noise = scale * peaks.picture_noise(grey) / np.sqrt(settings.smoothing)
    least = 0.5 * settings.min_contrast * 255.0
    search = peaks.Search(
        box=settings.smoothing,
        threshold=max(least, _LOOK * noise),
        rival=max(least, _LOOK_AGAIN * noise),
        max_sigma=settings.max_sigma,
    )
    candidates = peaks.find(grey, scale, search, mask)
    found = candidates.found
    index = path.choose(candidates) if settings.path else np.where(found[:, 0], 0, -1)
    rows = np.flatnonzero(index >= 0)
    chosen = candidates[rows, index[rows]]
    limits = _valleys(candidates[rows], chosen)
    parts = [
        _measure(grey, scale, rows[part], chosen[part], limits[part], settings)
        for part in _by_width(chosen.width)
    ]
    return _joined(parts)


def _valleys(candidates: peaks.Peaks, chosen: peaks.Peaks) -> Floats:
    """Return the columns half way to the next peaks, left and right, (n, 2); infinite if none."""
    limits = np.tile([-np.inf, np.inf], (len(chosen.column), 1))
    rivals = np.flatnonzero(candidates.found.sum(axis=1) > 1)
    if len(rivals):
        near = candidates[rivals]
        middle = chosen.column[rivals, None]
        half = np.where(near.found, 0.5 * (near.column + middle), np.nan)
        with np.errstate(invalid='ignore'):
            left, right = (
                np.where(half < middle, half, -np.inf),
                np.where(half > middle, half, np.inf),
            )
        limits[rivals] = np.stack([left.max(axis=1), right.min(axis=1)], axis=1)
    return limits


def _by_width(width: Singles) -> list[Ints]:
    """Sort peaks into usual and wide ones, so that few wide ones do not cost all a wide patch."""
    if not len(width):
        return []
    wide = width > _USUAL * np.median(width)
    groups = [np.flatnonzero(~wide), np.flatnonzero(wide)]
    return [group for group in groups if len(group)]


def _measure(
    grey: Image,
    scale: float,
    rows: Ints,
    rough: peaks.Peaks,
    limits: Floats,
    settings: ExtractSettings,
) -> Stripe:
    patches = Patches.cut(grey, scale, rows, rough, settings.window, limits)
    estimate = METHODS[settings.method](patches, settings.noise)
    u = patches.column + estimate.place
    sigma = np.hypot(estimate.sigma, estimate.doubt)
    good = _is_stripe(patches, estimate, settings) & (sigma <= settings.max_error)
    half = 2.2 * estimate.width
    good &= (u - half >= -0.5) & (u + half <= grey.shape[1] - 0.5)
    found = Stripe(
        uv=np.stack([u, rows], axis=1),
        intensity=estimate.height,
        width=estimate.width,
        sigma=sigma,
    )
    return found[good]


def _is_stripe(patches: Patches, estimate: Estimate, settings: ExtractSettings) -> Bools:
    rough = patches.rough
    moved = np.abs(estimate.place + patches.column - rough.column - rough.middle)
    # NaN fits nowhere
    return np.asarray(
        (estimate.snr >= settings.min_snr)
        & (estimate.height >= settings.min_contrast * 255.0)
        & (estimate.width <= settings.max_sigma)
        & (moved <= 1.5 * rough.width + 1.0)
    )


def _joined(parts: list[Stripe]) -> Stripe:
    """Put the rows of several stripes together, in order."""
    if not parts:
        none = np.zeros(0)
        return Stripe(uv=np.zeros((0, 2)), intensity=none, width=none, sigma=none)
    names = ('uv', 'intensity', 'width', 'sigma')
    arrays = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    return Stripe(**arrays)[np.argsort(arrays['uv'][:, 1], kind='stable')]
