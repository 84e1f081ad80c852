# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Peak detection in the rows of an image: up to three peaks per row with column, width and height.

The rows are smoothed by a box filter. The highest peak is measured at offsets that grow
geometrically, then it is set to zero and the row is searched again. Only rows whose second peak
is above the threshold are searched for a third.
"""

from dataclasses import dataclass
from typing import Any
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from ivfmc_ros.model import Bools
from ivfmc_ros.model import Bytes
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Image
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Singles
from ivfmc_ros.stripe.row_windows import row_windows

# Peaks per row at rank: the stripe, and two reflections or stripes of another surface.
CANDIDATES = 3

FWHM_PER_SIGMA = 2.0 * np.sqrt(2.0 * np.log(2.0))

# Offsets in pixels at which a peak is sampled: dense at the peak, sparse at the background.
_OFFSETS = np.array([0, 1, 2, 3, 4, 6, 8, 11, 15, 20, 27, 36, 48, 64, 85, 113, 150])
# Half width of the interval that is set to zero around a found peak, in sigmas of a wide peak.
_BLANKED_SIGMAS = 3.0
# Half width of the morphological opening that estimates a broad background, in ``max_sigma``.
_BACKGROUND_SIGMAS = 2.0
# A further peak below this fraction of the highest one is a side lobe of it.
_MIN_HEIGHT_RATIO = 0.1
# Half width of the level search to each side of a peak, in ``max_sigma``.
_SAMPLED_SIGMAS = 3.0


@dataclass(frozen=True, eq=False)
class Peaks:
    """
    Peaks of the rows of an image, gray values scaled to 0 to 255.

    All arrays are (rows,) or (rows, candidates).

    column : int64, pixels, column of the smoothed maximum
    middle : float32, pixels from ``column`` to the midpoint between the half-height crossings
    width : float32, pixels, sigma of a Gaussian of the same full width at half maximum; NaN where
        there is no peak
    height : float32, above the brighter of the backgrounds of both sides
    level : float32, the darker of these backgrounds
    top : float32, gray value of the smoothed maximum
    """

    column: Ints
    middle: Singles
    width: Singles
    height: Singles
    level: Singles
    top: Singles

    @property
    def found(self) -> Bools:
        """Mask of the entries that hold a peak."""
        return np.isfinite(self.width)

    def __getitem__(self, chosen: Any) -> 'Peaks':
        return Peaks(*(array[chosen] for array in self.arrays()))

    def arrays(self) -> tuple[NDArray[Any], ...]:
        """Return all arrays in the order of the constructor."""
        return self.column, self.middle, self.width, self.height, self.level, self.top


@dataclass(frozen=True, eq=False)
class PeakSearch:
    """
    Parameters of the peak detection. Gray values are scaled to 0 to 255.

    box : pixels, odd; width of the box filter along rows
    threshold : minimum height of the first peak of a row
    further_threshold : minimum height of further peaks
    max_sigma : pixels; peaks with a larger sigma are rejected
    dark : gray value of unlit pixels of the image
    """

    box: int
    threshold: float
    further_threshold: float
    max_sigma: float
    dark: float = 0.0


def sample_offsets(max_sigma: float) -> Ints:
    """Return the offsets (pixels) from a peak at which it is sampled, to each side."""
    return _OFFSETS[: 1 + np.searchsorted(_OFFSETS, _SAMPLED_SIGMAS * max_sigma)]


def find_peaks(gray: Image, scale: float, search: PeakSearch, mask: Bytes | None) -> Peaks:
    """
    Return the peaks of every row, (rows, ``CANDIDATES``), the highest first.

    gray : (rows, columns) uint8 or uint16
    scale : factor from ``gray`` to gray values of 0 to 255
    mask : (rows, columns) uint8, 255 where peaks may be, else 0; None for everywhere
    """
    smooth = cast(Image, cv2.blur(gray, (search.box, 1), borderType=cv2.BORDER_REPLICATE))
    left = _masked(smooth, mask)
    height = len(gray)
    rows = np.arange(height)
    first = _measure(smooth, scale, search, rows, left.argmax(axis=1))
    broad_rows = _rows_with_broad_light(search, first)
    if len(broad_rows):
        left[broad_rows] = _top_hat(left[broad_rows], search)
        again = _measure(smooth, scale, search, broad_rows, left[broad_rows].argmax(axis=1))
        again.width[again.height < search.further_threshold] = np.nan
        for array, values in zip(first.arrays(), again.arrays(), strict=True):
            array[broad_rows] = values
    column = np.zeros((CANDIDATES, height), dtype=np.int64)
    rest = np.full((5, CANDIDATES, height), np.nan, dtype=np.float32)
    _store(column, rest, 0, slice(None), first)
    strongest = np.where(first.found, first.height, 0.0)
    last = first
    for k in range(1, CANDIDATES):
        _blank(left, last)
        least = last.level + np.maximum(search.further_threshold, _MIN_HEIGHT_RATIO * strongest)
        # max is three times as fast as argmax: argmax only where a peak is possible
        lit = np.flatnonzero(scale * left.max(axis=1) > least)
        if not len(lit):
            break
        rows, left, strongest = rows[lit], left[lit], strongest[lit]
        last = _measure(smooth, scale, search, rows, left.argmax(axis=1))
        # a flank of the previous peak outside the blanked interval has no height of its own
        is_peak = last.found & (
            last.height >= np.maximum(search.further_threshold, _MIN_HEIGHT_RATIO * strongest)
        )
        _store(column, rest, k, rows[is_peak], last[is_peak])
    return Peaks(column.T, *rest.transpose(0, 2, 1))


def _masked(smooth: Image, mask: Bytes | None) -> Image:
    """Return a copy that is zero outside of the mask."""
    if mask is None:
        return smooth.copy()
    # bitwise and with 255 takes a quarter of the time of a masked copy
    if smooth.dtype == np.uint8:
        return cast(Image, cv2.bitwise_and(smooth, mask))
    return cast(Image, cv2.bitwise_and(smooth, smooth, mask=mask))


def _rows_with_broad_light(search: PeakSearch, first: Peaks) -> Ints:
    """Return rows with a bright area wider than a stripe, whose texture would hide the stripe."""
    top = first.top - search.dark
    # top - height is the background of the brighter side
    broad = ~first.found | (top - first.height > 0.5 * top)
    return np.flatnonzero(broad & (top >= 2.0 * search.further_threshold))


def _top_hat(smooth: Image, search: PeakSearch) -> Image:
    """Subtract structures wider than a stripe (white top-hat transform along rows)."""
    size = 2 * int(_BACKGROUND_SIGMAS * search.max_sigma) + 1
    background_image = cv2.morphologyEx(smooth, cv2.MORPH_OPEN, np.ones((1, size), dtype=np.uint8))
    return cast(Image, cv2.subtract(smooth, background_image))


def _store(column: Ints, rest: Singles, k: int, rows: Ints | slice, peaks: Peaks) -> None:
    column[k, rows] = peaks.column
    for array, values in zip(rest, peaks.arrays()[1:], strict=True):
        array[k, rows] = values


def _blank(smooth: Image, peaks: Peaks) -> None:
    """Set the interval around one peak per row to zero."""
    # one width for all rows: the 90th percentile; remains of wider peaks are rejected later
    widths = peaks.width[peaks.found]
    rank = 9 * len(widths) // 10
    typical_width = float(np.partition(widths, rank)[rank]) if len(widths) else 1.0
    width = smooth.shape[1]
    half_width = min(int(np.ceil(_BLANKED_SIGMAS * typical_width)) + 2, (width - 1) // 2)
    windows = row_windows(smooth, 2 * half_width + 1, writeable=True)
    first = np.minimum(np.maximum(peaks.column - half_width, 0), width - 1 - 2 * half_width)
    windows[np.arange(len(smooth)), first] = 0


def _measure(smooth: Image, scale: float, search: PeakSearch, rows: Ints, columns: Ints) -> Peaks:
    """Measure one peak at ``columns`` in each of ``rows`` of ``smooth``."""
    offsets = sample_offsets(search.max_sigma)
    # (offsets, 2 n): left sides of all peaks, then right sides
    sides = _sides(smooth, scale, rows, columns, offsets)
    levels = _level(sides)
    half_width = _first_below(sides, 0.5 * (sides[0] + levels), offsets).reshape(2, -1)
    levels = levels.reshape(2, -1)
    top = sides[0, : len(rows)]
    height = top - levels.max(axis=0)
    # subtract the variance of the box filter
    variance = ((half_width[0] + half_width[1]) / FWHM_PER_SIGMA) ** 2 - (search.box**2 - 1) / 12.0
    width = np.sqrt(np.maximum(variance, 0.25)).astype(np.float32)
    with np.errstate(invalid='ignore'):
        width[(height < search.threshold) | (width > search.max_sigma)] = np.nan
    middle = (0.5 * (half_width[1] - half_width[0])).astype(np.float32)
    return Peaks(columns, middle, width, height, levels.min(axis=0), top)


def _sides(smooth: Image, scale: float, rows: Ints, columns: Ints, offsets: Ints) -> Singles:
    """Return gray values at offsets left of all peaks, then right of them, (offsets, 2 n)."""
    last = smooth.shape[1] - 1
    away = offsets[:, None]
    indices = np.concatenate([columns - away, columns + away], axis=1)
    if columns.min(initial=last) < offsets[-1] or columns.max(initial=0) > last - offsets[-1]:
        indices = np.minimum(np.maximum(indices, 0), last)
    starts = rows * (last + 1)
    indices += np.concatenate([starts, starts])
    return np.multiply(smooth.reshape(-1).take(indices), scale, dtype=np.float32)


def _level(side: Singles) -> Singles:
    """Return the background on one side: the minimum of means of two samples, against noise."""
    outer = side[len(side) // 3 :]
    return np.asarray(0.5 * (outer[:-1] + outer[1:]).min(axis=0))


def _first_below(side: Singles, level: Singles, offsets: Ints) -> Floats:
    """Return the interpolated offset at which values first fall below level; NaN if never."""
    below = side < level
    # skip the peak pixel, which speckle can darken
    below[0] = False
    index = below.argmax(axis=0)
    before = np.maximum(index - 1, 0)
    values, count = side.reshape(-1), side.shape[1]
    peak = np.arange(count)
    last, first = values.take(before * count + peak), values.take(index * count + peak)
    with np.errstate(divide='ignore', invalid='ignore'):
        fraction = np.minimum(np.maximum((last - level) / (last - first), 0.0), 1.0)
        half_width = offsets[before] + fraction * (offsets[index] - offsets[before])
        return np.where(index > 0, half_width, np.nan)
