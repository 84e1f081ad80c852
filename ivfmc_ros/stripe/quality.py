# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Uncertainty of stripe positions due to profiles that are not Gaussian, from skew, misfit and width.

A stripe that is cut by an edge, crosses a change of reflectance, or is scattered inside the
material to one side is not a symmetric Gaussian: its residuals are larger than the noise, it is
skewed, and its width differs from that a sampled rows away. Speckle hides this in a single row;
therefore skew and width are averaged along the stripe, over which speckle is independent.
"""

from typing import TypeVar

import numpy as np

from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Singles
from ivfmc_ros.stripe.estimators.patches import PeakEstimate
from ivfmc_ros.stripe.row_windows import row_windows

Widths = TypeVar('Widths', Floats, Singles)

# A segment of the stripe ends at a step of more pixels per row, or at a gap of more rows.
_MAX_SLOPE = 4.0
_MAX_GAP = 3
# Rows to each side over which skew and width are averaged.
_MEAN_ROWS = 3
# Rows to each side of the moving median of the width, and the step at which it is evaluated.
_MEDIAN_ROWS = 20
_MEDIAN_STEP = 4
# Error of the position, in sigmas of the stripe, per unit of skew, misfit and relative change of
# width. Chosen on stripes cut by an edge or a change of reflectance (bench_stripe: edge_bias).
_ERROR_PER_SKEW = 4.0
_ERROR_PER_MISFIT = 0.08
_ERROR_PER_WIDTH_CHANGE = 1.7
# The same for a width below the least width of a whole stripe.
_ERROR_PER_NARROWING = 5.0
# Distance of the position from the midpoint at half height that is not an error: pixels, plus a
# fraction of the width.
_MIDPOINT_TOLERANCE = 0.2
_MIDPOINT_TOLERANCE_FRACTION = 0.35
# Skew and width change count as far as they exceed this many of their own sigmas.
_SIGNIFICANCE = 2.0
# Skew from which a change of width has full weight, and its weight without skew.
_FULL_WEIGHT_SKEW = 0.03
_MIN_WEIGHT = 0.4
# Relative change of width that the curvature of a surface may cause.
_WIDTH_TOLERANCE = 0.06


def shape_uncertainty(
    rows: Ints, u: Floats, estimate: PeakEstimate, least: float | None
) -> Floats:
    """
    Return the uncertainty (1 sigma, pixels) of each position beyond pixel noise, (n,) float64.

    rows : (n,) ascending; u : (n,) columns of the stripe
    least : pixels, sigma of the narrowest stripe that is not cut; None if not known
    """
    if not len(rows):
        return np.zeros(0)
    first, after = _neighbors(rows, u)
    count = after - first
    # the sigma of the width is about that of the position
    squares = np.stack([estimate.skew_sigma, estimate.sigma]) ** 2
    averaged = np.stack([estimate.skew, estimate.width, *squares])
    skew, width, skew_square, width_square = _mean(averaged, first, after)
    excess_skew = np.maximum(np.abs(skew) - _SIGNIFICANCE * np.sqrt(skew_square / count), 0.0)
    median = median_width(estimate.width)
    width_sigma = np.sqrt(width_square / count) / median
    change = np.abs(width / median - 1.0) - _WIDTH_TOLERANCE - _SIGNIFICANCE * width_sigma
    least = least or 1e-3
    scale = np.maximum(np.maximum(estimate.width, median), least)
    misfit = np.sqrt(np.maximum(estimate.misfit**2 - 1.0, 0.0))
    # a different width with a Gaussian profile may be a different face: less weight
    weight = np.minimum(_MIN_WEIGHT + excess_skew / _FULL_WEIGHT_SKEW + misfit, 1.0)
    change = np.maximum(change, 0.0) * weight
    narrowing = np.maximum(1.0 - width / least, 0.0)
    parts = (
        _ERROR_PER_SKEW * excess_skew,
        _ERROR_PER_MISFIT * misfit,
        _ERROR_PER_WIDTH_CHANGE * change,
        _ERROR_PER_NARROWING * narrowing,
    )
    distance = estimate.midpoint_distance - _MIDPOINT_TOLERANCE_FRACTION * scale
    excess = np.maximum(distance - _MIDPOINT_TOLERANCE, 0.0)
    return np.asarray(np.sqrt(scale**2 * sum(part**2 for part in parts) + excess**2))


def median_width(width: Widths) -> Widths:
    """Return the moving median of the width along the stripe, from every fourth row."""
    if not len(width):
        return width
    sampled = width[::_MEDIAN_STEP]
    half = min(_MEDIAN_ROWS // _MEDIAN_STEP, (len(sampled) - 1) // 2)
    # for a few hundred values three times as fast as scipy.ndimage.median_filter
    ends = np.repeat(sampled[[0, -1]], half)
    windows = row_windows(np.concatenate([ends[:half], sampled, ends[half:]]), 2 * half + 1)
    medians = np.partition(windows, half, axis=1)[:, half]
    return np.asarray(np.repeat(medians, _MEDIAN_STEP)[: len(width)])


def _neighbors(rows: Ints, u: Floats) -> tuple[Ints, Ints]:
    """Return for each point the first, and one past the last, of its neighbors on its segment."""
    starts = segment_starts(rows, u)
    segment = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    index = np.arange(len(rows))
    return (
        np.maximum(index - _MEAN_ROWS, starts[segment]),
        np.minimum(index + _MEAN_ROWS + 1, starts[segment + 1]),
    )


def segment_starts(rows: Ints, u: Floats) -> Ints:
    """Return the start index of each connected segment of the stripe, then the length n."""
    gap = np.diff(rows)
    broken = (gap > _MAX_GAP) | (np.abs(np.diff(u)) > _MAX_SLOPE * gap)
    return np.concatenate([[0], np.flatnonzero(broken) + 1, [len(rows)]])


def _mean(values: Floats, first: Ints, after: Ints) -> Floats:
    """Return the means of (k, n) values over the neighbors of each point, (k, n)."""
    total = np.zeros((len(values), values.shape[1] + 1))
    np.cumsum(values, axis=1, out=total[:, 1:])
    return np.asarray((total[:, after] - total[:, first]) / (after - first))
