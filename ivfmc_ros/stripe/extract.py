# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Extraction of a laser stripe from an image: one sub-pixel position per image row (or column).

Peaks above the noise are detected in every row (``peaks``), one peak per row is selected by a
minimum-cost path along the stripe (``path_search``), and its position is estimated from the
pixels around it (``estimators``). ``quality`` adds the uncertainty of a non-Gaussian profile. In
images with inter-reflections, thin stripes are searched instead (``glare``, ``ridges``).
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
from ivfmc_ros.stripe import glare
from ivfmc_ros.stripe import path_search
from ivfmc_ros.stripe import peaks
from ivfmc_ros.stripe import quality
from ivfmc_ros.stripe import smoothing
from ivfmc_ros.stripe.cropped_image import CroppedImage
from ivfmc_ros.stripe.estimators import DEFAULT
from ivfmc_ros.stripe.estimators import METHODS
from ivfmc_ros.stripe.estimators import NOISE_INDEPENDENT
from ivfmc_ros.stripe.estimators.patches import Patches
from ivfmc_ros.stripe.estimators.patches import PeakEstimate
from ivfmc_ros.stripe.noise import SensorNoise
from ivfmc_ros.stripe.roi import RegionOfInterest
from ivfmc_ros.stripe.settings import ExtractSettings
from ivfmc_ros.stripe.stripe import Stripe

__all__ = ['ExtractSettings', 'Stripe', 'extract']

# Detection threshold of the first peak of a row, in sigmas of the smoothed image noise.
_FIRST_PEAK_SNR = 4.0
# The same for further peaks; higher, because a row of a thousand pixels has a 4 sigma noise peak.
_FURTHER_PEAK_SNR = 7.0
# Peaks wider than this multiple of the median width are estimated separately, in wider patches,
_WIDE_FACTOR = 1.4
# if that saves this many pixels: a second run of the estimator costs as much time.
_MIN_SAVED_PIXELS = 15_000
# A detected width above this multiple of its neighbors' median has merged with a second peak.
_MERGED_FACTOR = 1.3
# Minimum ratio of the estimated signal-to-noise ratio to the misfit of the Gaussian.
_MIN_SNR_PER_MISFIT = 3.0
# Sigmas of the stripe to each side that must lie inside the image; a cut stripe is biased.
_BORDER_MARGIN = 2.2


def extract(
    image: Image,
    stripe: Direction = 'rows',
    settings: ExtractSettings | None = None,
    region: RegionOfInterest | None = None,
) -> Stripe:
    """
    Extract the stripe from an image.

    image : (h, w) mono or (h, w, 3) BGR, uint8 or uint16
    stripe : 'rows' for one point in every row, 'columns' for one in every column
    region : region of interest; None for the whole image
    returns : (n,) points; rows without a stripe, or with one cut by the image border, are absent
    """
    settings = settings or ExtractSettings()
    crop = CroppedImage.of(image, stripe, settings, region)
    (rows, u, estimate), is_thin = _estimates_by_glare(crop, settings)
    limit = settings.max_uncertainty * (glare.UNCERTAINTY_FRACTION if is_thin else 1.0)
    sigma = estimate.sigma
    noise_sigma = np.zeros_like(sigma) if settings.method in NOISE_INDEPENDENT else sigma
    kept = noise_sigma <= settings.max_error
    if len(rows):
        kept &= estimate.width <= settings.max_widening * np.median(estimate.width)
    if settings.shape_uncertainty:
        shape = quality.shape_uncertainty(rows, u, estimate, settings.least_width)
        sigma = np.hypot(sigma, shape)
        kept &= np.hypot(noise_sigma, shape) <= limit * estimate.width
    if settings.along and len(rows):
        u, sigma = smoothing.smooth(rows, u, sigma, settings.along)
    u, rows = u + crop.first[1], rows + crop.first[0]
    found = Stripe(
        uv=np.stack([u, rows] if stripe == 'rows' else [rows, u], axis=1),
        intensity=estimate.height,
        width=estimate.width,
        sigma=sigma,
    )
    return found[kept]


def rows_with_glare(
    image: Image,
    direction: Direction,
    settings: ExtractSettings,
    region: RegionOfInterest | None,
    found: Stripe,
) -> Bools:
    """Return which points of a stripe have broad light beside them, (n,); see ``extract``."""
    crop = CroppedImage.of(image, direction, settings, region)
    u, rows = (found.uv if direction == 'rows' else found.uv[:, ::-1]).T
    return glare.shows_glare(
        crop,
        np.rint(rows).astype(np.int64) - crop.first[0],
        u - crop.first[1],
        found.width,
        found.intensity,
    )


def _estimates_by_glare(
    crop: CroppedImage, settings: ExtractSettings
) -> tuple[tuple[Ints, Floats, PeakEstimate], bool]:
    """Return rows, columns and estimates, and whether they are those of thin stripes."""
    choice, width = settings.glare, settings.expected_width
    if settings.method not in ('auto', DEFAULT) or (choice == 'auto' and width is None):
        choice = 'off'
    if choice == 'on' and width is not None:
        return _glare_estimates(crop, settings, width), True
    found = _estimates(crop, settings)
    rows, u, estimate = found
    if choice == 'auto':
        shown = glare.shows_glare(crop, rows, u, estimate.width, estimate.height)
        choice = 'on' if glare.is_glaring(shown) else 'off'
    width = width or glare.expected_width(estimate.width)
    if choice == 'off' or width is None:
        return found, False
    return _glare_estimates(crop, settings, width), True


def _glare_estimates(
    crop: CroppedImage, settings: ExtractSettings, width: float
) -> tuple[Ints, Floats, PeakEstimate]:
    thin = glare.thin_stripe(crop, settings, width)
    if not len(thin.rows):
        return _estimates_of([])
    estimate = METHODS[DEFAULT](thin.patches, settings.noise or SensorNoise())
    good = _is_stripe(thin.patches, estimate, settings)
    u = thin.patches.column + estimate.position
    good &= _is_inside(crop, u, estimate)
    thin, u, estimate = thin[good], u[good], estimate[good]
    clean = glare.has_no_tails(crop, thin, u, estimate)
    good = glare.accepted(thin, u, estimate.width, clean)
    thin, u, estimate, clean = thin[good], u[good], estimate[good], clean[good]
    if not len(u):
        return _estimates_of([])
    u, estimate = glare.along_stripe(thin, u, estimate, clean)
    return thin.rows, u, estimate


def _estimates(crop: CroppedImage, settings: ExtractSettings) -> tuple[Ints, Floats, PeakEstimate]:
    """Return the rows (ascending), columns and estimates of all accepted peaks of a crop."""
    return _estimates_of(
        [
            _estimate(rows, patches, crop, settings)
            for rows, patches in stripe_patches(crop, settings)
        ]
    )


def _estimates_of(
    groups: list[tuple[Ints, Floats, PeakEstimate]],
) -> tuple[Ints, Floats, PeakEstimate]:
    """Return groups of estimates as one, rows ascending."""
    if not groups:
        none = np.zeros(0)
        return none.astype(np.int64), none, PeakEstimate(*[none] * len(fields(PeakEstimate)))
    if len(groups) == 1:
        return groups[0]
    rows, u = (np.concatenate(arrays) for arrays in list(zip(*groups, strict=True))[:2])
    order = np.argsort(rows)
    return rows[order], u[order], PeakEstimate.concatenated([found[2] for found in groups])[order]


def _estimate(
    rows: Ints, patches: Patches, crop: CroppedImage, settings: ExtractSettings
) -> tuple[Ints, Floats, PeakEstimate]:
    method = DEFAULT if settings.method == 'auto' else settings.method
    estimate = METHODS[method](patches, settings.noise or SensorNoise())
    u = patches.column + estimate.position
    good = _is_stripe(patches, estimate, settings) & _is_inside(crop, u, estimate)
    # a position without an uncertainty would outweigh all others
    good &= estimate.sigma > 0.0
    if good.all():
        return rows, u, estimate
    return rows[good], u[good], estimate[good]


def _is_inside(crop: CroppedImage, u: Floats, estimate: PeakEstimate) -> Bools:
    """Return which stripes the border of the image does not cut, which would bias them."""
    half = _BORDER_MARGIN * estimate.width
    left, right = -crop.first[1] - 0.5, crop.columns - crop.first[1] - 0.5
    return np.asarray((u - half >= left) & (u + half <= right))


def stripe_patches(
    crop: CroppedImage, settings: ExtractSettings
) -> Iterator[tuple[Ints, Patches]]:
    """
    Yield patches around the selected peak of every row that has one, narrow peaks first.

    yields : (n,) rows of the crop, and their patches
    """
    noise = crop.scale * crop.noise / np.sqrt(settings.smoothing)
    least = 0.5 * settings.min_contrast * 255.0
    search = peaks.PeakSearch(
        box=settings.smoothing,
        threshold=max(least, _FIRST_PEAK_SNR * noise),
        further_threshold=max(least, _FURTHER_PEAK_SNR * noise),
        max_sigma=settings.max_sigma,
        dark=crop.scale * crop.dark,
    )
    candidates = peaks.find_peaks(crop.gray, crop.scale, search, crop.mask)
    index = (
        path_search.select_peaks(candidates)
        if settings.path
        else path_search.highest_peaks(candidates)
    )
    rows = np.flatnonzero(index >= 0)
    chosen = _with_limited_width(candidates[rows, index[rows]])
    limits = _midpoints(candidates, rows, chosen)
    for group in _by_width(chosen.width, settings):
        within = None if limits is None else limits[group]
        where = crop.gray, crop.scale, rows[group]
        yield rows[group], Patches.cut(*where, chosen[group], settings.window, within)


def _with_limited_width(chosen: peaks.Peaks) -> peaks.Peaks:
    """Limit detected widths to a multiple of the median around them."""
    median = quality.median_width(chosen.width)
    return replace(chosen, width=np.minimum(chosen.width, _MERGED_FACTOR * median))


def _midpoints(candidates: peaks.Peaks, rows: Ints, chosen: peaks.Peaks) -> Floats | None:
    """Return the columns halfway to the next peaks, left and right, (n, 2); None without any."""
    others = candidates.found[:, 1:]
    if not others.any():
        return None
    rivals = np.flatnonzero(others[rows].any(axis=1))
    limits = np.tile([-np.inf, np.inf], (len(rows), 1))
    selected = candidates[rows[rivals]]
    middle = chosen.column[rivals, None]
    half = np.where(selected.found, 0.5 * (selected.column + middle), np.nan)
    with np.errstate(invalid='ignore'):
        left = np.where(half < middle, half, -np.inf)
        right = np.where(half > middle, half, np.inf)
    limits[rivals] = np.stack([left.max(axis=1), right.min(axis=1)], axis=1)
    return limits


def _by_width(width: Singles, settings: ExtractSettings) -> list[Ints]:
    """Split peaks into normal and wide ones if few wide ones would enlarge all patches."""
    if not len(width):
        return []
    median = np.partition(width, len(width) // 2)[len(width) // 2]
    possible = width <= settings.max_widening * median
    narrow = width <= _WIDE_FACTOR * median
    extra = width[possible].max() - width[narrow].max()
    if 2.0 * settings.window * extra * np.count_nonzero(narrow) <= _MIN_SAVED_PIXELS:
        return [np.flatnonzero(possible)]
    return [np.flatnonzero(narrow), np.flatnonzero(possible & ~narrow)]


def _is_stripe(patches: Patches, estimate: PeakEstimate, settings: ExtractSettings) -> Bools:
    # comparisons with NaN are false
    return np.asarray(
        (estimate.snr >= settings.min_snr)
        & (estimate.snr >= _MIN_SNR_PER_MISFIT * estimate.misfit)
        & (estimate.height >= settings.min_contrast * 255.0)
        & (estimate.width <= settings.max_sigma)
        & (estimate.midpoint_distance <= 1.5 * patches.rough.width + 1.0)
    )
