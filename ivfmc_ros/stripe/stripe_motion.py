# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Motion of a stripe in images of one laser at one position of the table.

While nothing moves, the stripe is at the same pixels. It creeps while a laser warms up, and shakes
while table and part come to rest. The speckle of a part that stands is the same in all images, so
that the shift between two of them is known better than the position of the stripe in either.
"""

from collections import deque
from dataclasses import dataclass
import math

import numpy as np

from ivfmc_ros.model import Floats
from ivfmc_ros.model import Image
from ivfmc_ros.model import Ints

# Lines across the stripe that are compared, at most and at least.
_MAX_LINES, _MIN_LINES = 300, 20
# Pixels to either side of the brightest one whose centroid is compared.
_HALF_WINDOW = 6
# A line shows the stripe where its brightest pixel is above the median by so many standard
# deviations of the image, and so many 8-bit DN.
_MIN_SNR, _MIN_HEIGHT_DN = 10.0, 8.0
# Images farther apart in time, seconds, are not of one series.
_MAX_PAUSE_S = 2.0
# Seconds of the past over which the rate is fitted, and images that it needs.
WINDOW_S = 20.0
_PARTS = (WINDOW_S, 0.5 * WINDOW_S, 0.25 * WINDOW_S)
_MIN_IMAGES = 8
# Table positions that differ by less, radians, are the same.
_SAME_ANGLE = 2e-4
# Standard error of a median of normal errors over that of their mean, and of a median absolute
# deviation.
_MEDIAN_ERROR, _PER_MAD = 1.25, 1.4826


@dataclass(frozen=True, kw_only=True)
class Shift:
    """Displacement of the stripe between two images, pixels, and its standard uncertainty."""

    pixels: float
    u: float


@dataclass(frozen=True, kw_only=True)
class StripeRate:
    """
    Velocity of the stripe in the image.

    laser : index in the order of the cell
    seconds : of the images from which it was fitted
    rate, u : pixels per second, and its standard uncertainty
    """

    laser: int
    seconds: float
    rate: float
    u: float

    def greatest_shift(self, seconds: float) -> float:
        """Return by how many pixels the stripe moves in a time at most, at a level of 95 %."""
        return (abs(self.rate) + 2.0 * self.u) * seconds


@dataclass(frozen=True, eq=False, kw_only=True)
class _Lines:
    """Where the lines across a stripe are looked at: indices (n, 2 h + 1) of their pixels."""

    row: Ints
    column: Ints
    offset: Floats

    def centroids(self, gray: Image) -> Floats:
        """Return (n,) pixels from the brightest one of the first image; NaN for no light."""
        values = gray[self.row, self.column].astype(np.float64)
        values -= values.min(axis=1, keepdims=True)
        with np.errstate(invalid='ignore', divide='ignore'):
            return np.asarray((values @ self.offset) / values.sum(axis=1))


class StripeMotion:
    """
    Follows the stripe from the first image of a laser at a position of the table.

    last : shift of the last image from the first; None where there is none
    """

    def __init__(self) -> None:
        self.last: Shift | None = None
        self._laser, self._angle = -1, math.nan
        self._first: Image | None = None
        self._lines: _Lines | None = None
        self._centroids: Floats = np.zeros(0)
        self._last_ns = 0
        self._series: deque[tuple[int, float]] = deque()

    def add(self, image: Image, laser: int, angle: float, stamp_ns: int) -> None:
        """
        Add an image in which exactly one laser is on.

        image : (height, width) or (height, width, 3)
        laser : index in the order of the cell
        angle : of the table, radians
        """
        pause_s = 1e-9 * (stamp_ns - self._last_ns)
        self._last_ns = stamp_ns
        is_same = laser == self._laser and abs(angle - self._angle) < _SAME_ANGLE
        first = self._first
        if first is None or not is_same or first.shape != image.shape or pause_s > _MAX_PAUSE_S:
            # most images of a scan are alone at their position: looked at with the second one
            self._laser, self._angle, self._first = laser, angle, image
            self._lines, self.last = None, None
            self._series.clear()
            return
        if self._lines is None:
            gray = _gray(first)
            self._lines = _find_lines(gray)
            self._centroids = self._lines.centroids(gray)
        self.last = _shift(self._lines.centroids(_gray(image)) - self._centroids)
        if self.last is not None:
            self._series.append((stamp_ns, self.last.pixels))
        while self._series and 1e-9 * (stamp_ns - self._series[0][0]) > WINDOW_S:
            self._series.popleft()

    @property
    def rate(self) -> StripeRate | None:
        """
        How fast the stripe moves; None for too few images.

        Of the images of ``WINDOW_S`` and of its last parts, those that tell most are used: a laser
        that was cold before these seconds says nothing of now.
        """
        if not self._series:
            return None
        stamps_ns, shifts = np.array(self._series, dtype=np.float64).T
        ages = 1e-9 * (stamps_ns[-1] - stamps_ns)
        fits = [_fitted(ages[ages <= part], shifts[ages <= part], self._laser) for part in _PARTS]
        known = [fit for fit in fits if fit is not None]
        return min(known, key=lambda fit: fit.greatest_shift(1.0)) if known else None


def _fitted(ages: Floats, shifts: Floats, laser: int) -> StripeRate | None:
    """Return the slope of shifts over time; None for too few images."""
    seconds = ages.mean() - ages if len(ages) else ages
    spread = float(seconds @ seconds)
    if len(ages) < _MIN_IMAGES or not spread > 0.0:
        return None
    rate = float(seconds @ shifts) / spread
    left = shifts - shifts.mean() - rate * seconds
    variance = float(left @ left) / (len(left) - 2)
    return StripeRate(
        laser=laser, seconds=float(np.ptp(seconds)), rate=rate, u=math.sqrt(variance / spread)
    )


def _gray(image: Image) -> Image:
    return image if image.ndim == 2 else image.max(axis=2)


def _find_lines(gray: Image) -> _Lines:
    """Return the lines across the stripe: rows, or columns where more of these show it."""
    scale = float(np.iinfo(gray.dtype).max) / 255.0
    sample = gray[::4, ::4].astype(np.float64)
    dark = float(np.median(sample))
    noise = _PER_MAD * float(np.median(np.abs(sample - dark)))
    threshold = dark + max(_MIN_SNR * noise, _MIN_HEIGHT_DN * scale)
    rows = np.flatnonzero(gray.max(axis=1) > threshold)
    columns = np.flatnonzero(gray.max(axis=0) > threshold)
    if len(rows) >= len(columns):
        row, column, offset = _windows(gray, rows)
        return _Lines(row=row, column=column, offset=offset)
    column, row, offset = _windows(gray.T, columns)
    return _Lines(row=row, column=column, offset=offset)


def _windows(gray: Image, lines: Ints) -> tuple[Ints, Ints, Floats]:
    """Return row and column indices (n, 2 h + 1) around the brightest pixels of some rows."""
    lines = lines[:: max(1, -(-len(lines) // _MAX_LINES))]
    offset = np.arange(-_HALF_WINDOW, _HALF_WINDOW + 1)
    peak = gray[lines].argmax(axis=1)
    inside = (peak >= _HALF_WINDOW) & (peak < gray.shape[1] - _HALF_WINDOW)
    column = peak[inside, None] + offset
    row = np.broadcast_to(lines[inside, None], column.shape)
    return row, column, offset.astype(np.float64)


def _shift(differences: Floats) -> Shift | None:
    """Return the median of the shifts of the lines; None where too few show the stripe."""
    known = differences[np.isfinite(differences)]
    if len(known) < _MIN_LINES:
        return None
    middle = float(np.median(known))
    scatter = _PER_MAD * float(np.median(np.abs(known - middle)))
    return Shift(pixels=middle, u=_MEDIAN_ERROR * scatter / math.sqrt(len(known)))
