# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Where the stripe is: one sub-pixel position in every row of a picture that shows it.

Peaks that stand out of the noise are found in every row, where a row has several the path along
the stripe decides, and the place of the chosen one is estimated from the pixels around it.
"""

from collections.abc import Iterator
from dataclasses import fields
from dataclasses import replace

import numpy as np

from ivfmc_ros.cell.laser import Stripe as Direction
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Image
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Singles
from ivfmc_ros.stripe import path_search
from ivfmc_ros.stripe import peaks
from ivfmc_ros.stripe import quality
from ivfmc_ros.stripe import smoothing
from ivfmc_ros.stripe.estimators import BLUNT
from ivfmc_ros.stripe.estimators import DEFAULT
from ivfmc_ros.stripe.estimators import METHODS
from ivfmc_ros.stripe.estimators.patches import Estimate
from ivfmc_ros.stripe.estimators.patches import Patches
from ivfmc_ros.stripe.noise import Noise
from ivfmc_ros.stripe.region import Region
from ivfmc_ros.stripe.roi import Part
from ivfmc_ros.stripe.settings import ExtractSettings
from ivfmc_ros.stripe.stripe import Stripe

__all__ = ['ExtractSettings', 'Stripe', 'extract']

# A smoothed peak must rise by so many sigmas of the picture's noise to be looked at.
_LOOK = 4.0
# A second one in the row must be beyond doubt, for every row has one in its noise.
_LOOK_AGAIN = 7.0
# Rows whose stripe is wider than this many medians are measured apart, in a wider patch.
_USUAL = 1.4
# ... if that saves so many pixels: estimating twice costs the time of as many.
_APART = 15_000
# A rough width of more than so many of its neighbours' is not believed.
_MERGED = 1.3
# What is left of a row without its stripe must be less than this share of the stripe.
_LIKE_A_STRIPE = 3.0
# So many sigmas of a stripe, left and right, must be on the picture.
_WHOLE = 2.2


def extract(
    image: Image,
    stripe: Direction = 'rows',
    settings: ExtractSettings | None = None,
    region: Region | None = None,
) -> Stripe:
    """
    Find the stripe in a picture.

    image : (h, w) mono or (h, w, 3) BGR, uint8 or uint16
    stripe : 'rows' for one point in every row, 'columns' for one in every column
    region : where the stripe can be; None for everywhere
    returns : without rows that have no stripe, or one that the picture's border cuts
    """
    settings = settings or ExtractSettings()
    part = Part.of(image, stripe, settings, region)
    rows, u, estimate = _estimates(part, settings)
    sigma = estimate.sigma
    known = np.zeros_like(sigma) if settings.method in BLUNT else sigma
    kept = known <= settings.max_error
    if len(rows):
        kept &= estimate.width <= settings.max_widening * np.median(estimate.width)
    if settings.doubt:
        doubt = quality.doubt(rows, u, estimate, settings.least_width)
        sigma = np.hypot(sigma, doubt)
        kept &= np.hypot(known, doubt) <= settings.max_doubt * estimate.width
    if settings.along and len(rows):
        u, sigma = smoothing.smooth(rows, u, sigma, settings.along)
    u, rows = u + part.first[1], rows + part.first[0]
    found = Stripe(
        uv=np.stack([u, rows] if stripe == 'rows' else [rows, u], axis=1),
        intensity=estimate.height,
        width=estimate.width,
        sigma=sigma,
    )
    return found[kept]


def _estimates(part: Part, settings: ExtractSettings) -> tuple[Ints, Floats, Estimate]:
    """Return rows (ascending), columns and estimates of all in the part that is a stripe."""
    parts = [
        _estimate(rows, patches, part, settings)
        for rows, patches in stripe_patches(part, settings)
    ]
    if not parts:
        none = np.zeros(0)
        return none.astype(np.int64), none, Estimate(*[none] * len(fields(Estimate)))
    if len(parts) == 1:
        return parts[0]
    rows, u = (np.concatenate(arrays) for arrays in list(zip(*parts, strict=True))[:2])
    order = np.argsort(rows)
    return rows[order], u[order], Estimate.joined([found[2] for found in parts])[order]


def _estimate(
    rows: Ints, patches: Patches, part: Part, settings: ExtractSettings
) -> tuple[Ints, Floats, Estimate]:
    method = DEFAULT if settings.method == 'auto' else settings.method
    estimate = METHODS[method](patches, settings.noise or Noise())
    u = patches.column + estimate.place
    # a stripe that the picture's border cuts is measured off its centre
    half = _WHOLE * estimate.width
    good = _is_stripe(patches, estimate, settings)
    left, right = -part.first[1] - 0.5, part.columns - part.first[1] - 0.5
    good &= (u - half >= left) & (u + half <= right)
    if good.all():
        return rows, u, estimate
    return rows[good], u[good], estimate[good]


def stripe_patches(part: Part, settings: ExtractSettings) -> Iterator[tuple[Ints, Patches]]:
    """
    Give the surroundings of the stripe's peak in every row that has one, narrow stripes first.

    yields : (n,) rows of the part, and their patches
    """
    noise = part.scale * part.noise / np.sqrt(settings.smoothing)
    least = 0.5 * settings.min_contrast * 255.0
    search = peaks.Search(
        box=settings.smoothing,
        threshold=max(least, _LOOK * noise),
        rival=max(least, _LOOK_AGAIN * noise),
        max_sigma=settings.max_sigma,
        dark=part.scale * part.dark,
    )
    candidates = peaks.find(part.grey, part.scale, search, part.mask)
    index = path_search.choose(candidates) if settings.path else path_search.brightest(candidates)
    rows = np.flatnonzero(index >= 0)
    chosen = _steadied(candidates[rows, index[rows]])
    limits = _valleys(candidates, rows, chosen)
    for group in _by_width(chosen.width, settings):
        within = None if limits is None else limits[group]
        where = part.grey, part.scale, rows[group]
        yield rows[group], Patches.cut(*where, chosen[group], settings.window, within)


def _steadied(chosen: peaks.Peaks) -> peaks.Peaks:
    """Return peaks none of which is much wider than those around: it has merged with a ghost."""
    usual = quality.usual_width(chosen.width)
    return replace(chosen, width=np.minimum(chosen.width, _MERGED * usual))


def _valleys(candidates: peaks.Peaks, rows: Ints, chosen: peaks.Peaks) -> Floats | None:
    """Return the columns half way to the next peaks, left and right, (n, 2); None if no rivals."""
    others = candidates.found[:, 1:]
    if not others.any():
        return None
    rivals = np.flatnonzero(others[rows].any(axis=1))
    limits = np.tile([-np.inf, np.inf], (len(rows), 1))
    near = candidates[rows[rivals]]
    middle = chosen.column[rivals, None]
    half = np.where(near.found, 0.5 * (near.column + middle), np.nan)
    with np.errstate(invalid='ignore'):
        left = np.where(half < middle, half, -np.inf)
        right = np.where(half > middle, half, np.inf)
    limits[rivals] = np.stack([left.max(axis=1), right.min(axis=1)], axis=1)
    return limits


def _by_width(width: Singles, settings: ExtractSettings) -> list[Ints]:
    """Sort peaks into usual and wide ones, where a few wide ones cost all a wide patch."""
    if not len(width):
        return []
    usual = np.partition(width, len(width) // 2)[len(width) // 2]
    possible = width <= settings.max_widening * usual
    narrow = width <= _USUAL * usual
    extra = width[possible].max() - width[narrow].max()
    if 2.0 * settings.window * extra * np.count_nonzero(narrow) <= _APART:
        return [np.flatnonzero(possible)]
    return [np.flatnonzero(narrow), np.flatnonzero(possible & ~narrow)]


def _is_stripe(patches: Patches, estimate: Estimate, settings: ExtractSettings) -> Bools:
    # NaN fits nowhere
    return np.asarray(
        (estimate.snr >= settings.min_snr)
        & (estimate.snr >= _LIKE_A_STRIPE * estimate.misfit)
        & (estimate.height >= settings.min_contrast * 255.0)
        & (estimate.width <= settings.max_sigma)
        & (estimate.moved <= 1.5 * patches.rough.width + 1.0)
    )
