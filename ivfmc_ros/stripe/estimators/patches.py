# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Patches of pixels around peaks, and the result that an estimator returns for each of them."""

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import fields
from typing import Any

import numpy as np

from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Image
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Singles
from ivfmc_ros.stripe.noise import SensorNoise
from ivfmc_ros.stripe.peaks import Peaks
from ivfmc_ros.stripe.row_windows import row_windows

# Gray value (0 to 255) from which a pixel counts as saturated.
CLIPPING_LEVEL = 254.5
# Sigma of a skew that an estimator does not provide; finite, so that means stay finite.
UNKNOWN_SIGMA = 1e3
# Standard deviation of the fitted height of a Gaussian with unknown position, width and
# background, for pixel noise 1 and sigma 1 pixel (from the Fisher matrix).
_HEIGHT_NOISE = 1.2


@dataclass(frozen=True, eq=False)
class Patches:
    """
    A patch of a row around each of n peaks, gray values scaled to 0 to 255.

    x : (w,) float32, pixels from ``column``, the same for all patches
    column : (n,) int64, column of the center pixel
    values : (n, w) float32
    used : (n, w) float32, 1 for pixels in the window of the estimate; 0 for those that are
        saturated, outside the image, or beyond the midpoint to another peak
    rough : the detected peaks, (n,) arrays
    pedestal : (n, w) float32, laser light under the stripe that is taken off ``values``; None for
        none
    """

    x: Singles
    column: Ints
    values: Singles
    used: Singles
    rough: Peaks
    pedestal: Singles | None = None

    @classmethod
    def cut(
        cls,
        gray: Image,
        scale: float,
        rows: Ints,
        rough: Peaks,
        window: float,
        limits: Floats | None,
    ) -> 'Patches':
        """
        Cut a patch around one peak in each of ``rows``.

        scale : factor from ``gray`` to gray values of 0 to 255
        window : half width of the window of the estimate, in sigmas of each peak
        limits : (n, 2) columns, first and last of each window; None for no limit
        """
        half = window * np.maximum(rough.width, 1.0) + 0.8
        column = rough.column + np.rint(rough.middle).astype(np.int64)
        half_width = int(np.ceil(float(half.max(initial=1.0)))) + 1
        steps = np.arange(-half_width, half_width + 1)
        width = gray.shape[1]
        inside = bool(column.min(initial=half_width) >= half_width)
        inside = inside and bool(column.max(initial=half_width) + half_width < width)
        if inside:
            columns = None
            pixels = row_windows(gray, len(steps))[rows, column - half_width]
        else:
            columns = column[:, None] + steps
            pixels = gray[rows[:, None], np.minimum(np.maximum(columns, 0), width - 1)]
        # Fortran order: the fit works on the contiguous transpose
        values: Singles = np.multiply(pixels.T, scale, dtype=np.float32, order='C').T
        x = steps.astype(np.float32)
        middle = (rough.column + rough.middle - column).astype(np.float32)
        used = (np.abs(x[:, None] - middle) <= half).T
        if columns is not None:
            used &= (columns >= 0) & (columns < width)
        if limits is not None:
            _apply_limits(used, column, steps, limits)
        bright = np.flatnonzero(pixels.max(axis=1) * scale >= CLIPPING_LEVEL)
        if len(bright):
            used[bright] &= ~_dilated(values[bright] >= CLIPPING_LEVEL)
        return cls(x, column, values, used.astype(np.float32), rough)

    def __len__(self) -> int:
        return len(self.column)

    def midpoint_distance(self, position: Floats) -> Floats:
        """Return the distances (pixels) of positions from the midpoint at half height."""
        return np.abs(position + (self.column - self.rough.column) - self.rough.middle)


def _apply_limits(used: Bools, column: Ints, steps: Ints, limits: Floats) -> None:
    """Clear ``used`` beyond the limits, in the few rows whose patch exceeds them."""
    half_width = steps[-1]
    affected = np.flatnonzero(
        (limits[:, 0] > column - half_width) | (limits[:, 1] < column + half_width)
    )
    if len(affected):
        columns = column[affected, None] + steps
        used[affected] &= (columns >= limits[affected, :1]) & (columns <= limits[affected, 1:])


def _dilated(clipped: Bools) -> Bools:
    """Return saturated pixels and their neighbors, into which they bloom."""
    dilated = clipped.copy()
    dilated[:, 1:] |= clipped[:, :-1]
    dilated[:, :-1] |= clipped[:, 1:]
    return dilated


def signal_to_noise(height: Floats, width: Floats, level: Floats, noise: SensorNoise) -> Floats:
    """Return the height over its standard deviation due to the noise of the background."""
    variance = noise.variance(level, np.zeros_like(level))
    return np.asarray(height / (_HEIGHT_NOISE * np.sqrt(variance / width)))


@dataclass(frozen=True, eq=False)
class PeakEstimate:
    """
    Result of an estimator for each patch, (n,) float64.

    position : pixels from the patch's center column; NaN if the estimate failed
    width : pixels, sigma of the stripe
    height : above the background, gray values of 0 to 255
    sigma : pixels, 1 sigma of ``position`` due to pixel noise
    snr : height over its standard deviation due to the noise of the background
    midpoint_distance : pixels from the midpoint at half height
    misfit : square root of the reduced chi^2 of the residuals, 1 or more
    skew, skew_sigma : skew as a fraction of the height, and its 1 sigma; ``UNKNOWN_SIGMA`` if
        the estimator does not provide it
    """

    position: Floats
    width: Floats
    height: Floats
    sigma: Floats
    snr: Floats
    midpoint_distance: Floats
    misfit: Floats
    skew: Floats
    skew_sigma: Floats

    def __getitem__(self, chosen: Any) -> 'PeakEstimate':
        return PeakEstimate(*(getattr(self, field.name)[chosen] for field in fields(self)))

    @classmethod
    def concatenated(cls, parts: Sequence['PeakEstimate']) -> 'PeakEstimate':
        """Concatenate estimates."""
        names = [field.name for field in fields(cls)]
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def estimate_from_peaks(
    patches: Patches, noise: SensorNoise, position: Floats | Singles, sigma: Floats | Singles
) -> PeakEstimate:
    """Return an estimate with the width and height of the detected peaks."""
    rough = patches.rough
    width, height, level = (
        array.astype(np.float64) for array in (rough.width, rough.height, rough.level)
    )
    valid = np.isfinite(position) & np.isfinite(sigma)
    position = np.where(valid, position, np.nan).astype(np.float64)
    return PeakEstimate(
        position=position,
        width=width,
        height=height,
        sigma=np.asarray(sigma, dtype=np.float64),
        snr=np.where(valid, signal_to_noise(height, width, level, noise), 0.0),
        midpoint_distance=patches.midpoint_distance(position),
        misfit=np.ones_like(width),
        skew=np.zeros_like(width),
        skew_sigma=np.full_like(width, UNKNOWN_SIGMA),
    )
