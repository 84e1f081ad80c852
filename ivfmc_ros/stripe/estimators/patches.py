# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The pixels around peaks, cut out so that all rows are measured at once."""

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Image
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Singles
from ivfmc_ros.stripe.noise import Noise
from ivfmc_ros.stripe.peaks import Peaks

# Grey values of 0 to 255 from which on a pixel counts as clipped.
FULL = 254.5
# An uncertainty that says nothing, and with which sums can still be taken.
UNTOLD = 1e3
# Standard deviation of a bell's height with free place, width and level, for noise 1 and sigma 1.
_HEIGHT_NOISE = 1.2


@dataclass(frozen=True, eq=False)
class Patches:
    """
    One stretch of a row around each peak, in grey values of 0 to 255.

    x : (w,) float32, pixels from ``column``, the same for all
    column : (n,) int64, of the middle
    values : (n, w) float32
    used : (n, w) float32, 1 for a pixel in the window that shows the stripe; 0 for one that is
        clipped, off the picture, or beyond the valley to another peak
    rough : what is known of each peak, (n,) arrays
    """

    x: Singles
    column: Ints
    values: Singles
    used: Singles
    rough: Peaks

    @classmethod
    def cut(
        cls,
        grey: Image,
        scale: float,
        rows: Ints,
        rough: Peaks,
        window: float,
        limits: Floats | None,
    ) -> 'Patches':
        """
        Cut out the surroundings of one peak in each of ``rows``.

        window : half of it, in sigmas of each peak
        limits : (n, 2) columns, first and last that may show the peak; None for all
        """
        half = window * np.maximum(rough.width, 1.0) + 0.8
        column = rough.column + np.rint(rough.middle).astype(np.int64)
        reach = int(np.ceil(float(half.max(initial=1.0)))) + 1
        steps = np.arange(-reach, reach + 1)
        width = grey.shape[1]
        inside = bool(column.min(initial=reach) >= reach)
        inside = inside and bool(column.max(initial=reach) + reach < width)
        if inside:
            places = None
            pixels = sliding_window_view(grey, len(steps), axis=1)[rows, column - reach]
        else:
            places = column[:, None] + steps
            pixels = grey[rows[:, None], np.minimum(np.maximum(places, 0), width - 1)]
        # in memory rows lie side by side, as the fit wants them
        values: Singles = np.multiply(pixels.T, scale, dtype=np.float32, order='C').T
        x = steps.astype(np.float32)
        middle = (rough.column + rough.middle - column).astype(np.float32)
        used = (np.abs(x[:, None] - middle) <= half).T
        if places is not None:
            used &= (places >= 0) & (places < width)
        if limits is not None:
            _within(used, column, steps, limits)
        bright = np.flatnonzero(pixels.max(axis=1) * scale >= FULL)
        if len(bright):
            used[bright] &= ~_grown(values[bright] >= FULL)
        return cls(x, column, values, used.astype(np.float32), rough)

    def __len__(self) -> int:
        return len(self.column)

    def moved(self, place: Floats) -> Floats:
        """Return how far places are from the middle at half height, pixels."""
        return np.abs(place + (self.column - self.rough.column) - self.rough.middle)


def _within(used: Bools, column: Ints, steps: Ints, limits: Floats) -> None:
    """Leave out pixels beyond the limits; few rows have any in reach."""
    reach = steps[-1]
    near = np.flatnonzero((limits[:, 0] > column - reach) | (limits[:, 1] < column + reach))
    if len(near):
        places = column[near, None] + steps
        used[near] &= (places >= limits[near, :1]) & (places <= limits[near, 1:])


def _grown(clipped: Bools) -> Bools:
    """Return clipped pixels and their neighbours, into which they bloom."""
    grown = clipped.copy()
    grown[:, 1:] |= clipped[:, :-1]
    grown[:, :-1] |= clipped[:, 1:]
    return grown


def signal_to_noise(height: Floats, width: Floats, level: Floats, noise: Noise) -> Floats:
    """Return the height over what the ground's noise makes of it where there is no stripe."""
    ground = noise.variance(level, np.zeros_like(level))
    return np.asarray(height / (_HEIGHT_NOISE * np.sqrt(ground / width)))


@dataclass(frozen=True, eq=False)
class Estimate:
    """
    What an estimator says of each patch, (n,) float64.

    place : pixels from the patch's middle column; NaN where it found nothing
    width : sigma of the stripe in pixels
    height : above the background, grey values of 0 to 255
    sigma : pixels, 1 sigma of ``place`` from the noise of the pixels
    snr : height over what the noise of the ground makes of it where there is no stripe
    moved : pixels from the middle at half height
    misfit : residuals over what the noise makes of them, 1 or more
    skew, skew_sigma : share of the height that is one-sided, and its 1 sigma; a sigma of
        ``UNTOLD`` where the estimator does not tell
    """

    place: Floats
    width: Floats
    height: Floats
    sigma: Floats
    snr: Floats
    moved: Floats
    misfit: Floats
    skew: Floats
    skew_sigma: Floats

    def __getitem__(self, chosen: Any) -> 'Estimate':
        return Estimate(*(getattr(self, field.name)[chosen] for field in fields(self)))

    @classmethod
    def joined(cls, parts: Sequence['Estimate']) -> 'Estimate':
        """Put estimates one after the other."""
        names = [field.name for field in fields(cls)]
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def of_rough(
    patches: Patches, noise: Noise, place: Floats | Singles, sigma: Floats | Singles
) -> Estimate:
    """Return an estimate with width and height as the search of peaks found them."""
    rough = patches.rough
    width, height, level = (
        array.astype(np.float64) for array in (rough.width, rough.height, rough.level)
    )
    told = np.isfinite(place) & np.isfinite(sigma)
    place = np.where(told, place, np.nan).astype(np.float64)
    return Estimate(
        place=place,
        width=width,
        height=height,
        sigma=np.asarray(sigma, dtype=np.float64),
        snr=np.where(told, signal_to_noise(height, width, level, noise), 0.0),
        moved=patches.moved(place),
        misfit=np.ones_like(width),
        skew=np.zeros_like(width),
        skew_sigma=np.full_like(width, UNTOLD),
    )
