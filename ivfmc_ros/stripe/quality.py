# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Where a stripe is not what the estimator takes it for, and by how much that can move its place.

A stripe that an edge cuts, that lies half on black and half on white, or that glows on one side
fits no symmetric bell: its residuals are too large, it leans to one side, and it is narrower or
wider than the same stripe a few rows away. Speckle hides this in a single row, so that lean and
width are averaged along the stripe, in which edges go on and speckle does not.
"""

from typing import TypeVar

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Singles
from ivfmc_ros.stripe.estimators.patches import Estimate

Widths = TypeVar('Widths', Floats, Singles)

# Stripes are one piece as long as they move by less than so many pixels a row.
_SLOPE = 4.0
_GAP = 3
# Rows to each side over which lean and width are averaged, and over which a width is usual.
_NEAR = 3
_USUAL = 20
_EVERY = 4
# How far the place is off, in sigmas of the stripe, for a lean, a misfit and a change of width
# of 1. Measured on cut and two-coloured stripes (bench: edge).
_BY_SKEW = 4.0
_BY_MISFIT = 0.08
_BY_WIDTH = 1.7
# The same for a stripe that is narrower than any surface makes it.
_BY_NARROW = 5.0
# The middle at half height may differ by so many pixels, and by this share of the width.
_MOVED = 0.2
_MOVED_SHARE = 0.35
# Certainty: lean and width count as far as they exceed so many of their own sigmas.
_CERTAIN = 2.0
# A lean from which on another width counts in full.
_SUSPECT = 0.03
# How far it counts where nothing leans.
_ALWAYS = 0.4
# A surface that bends changes the width by this share without harm.
_BEND = 0.06


def doubt(rows: Ints, u: Floats, estimate: Estimate, least: float | None) -> Floats:
    """
    Return by how many pixels each place can be off beyond its noise, (n,) float64.

    rows : (n,) ascending; u : (n,) columns of the stripe
    least : sigma in pixels of the laser's narrowest whole stripe; None: not known
    """
    if not len(rows):
        return np.zeros(0)
    first, after = _neighbours(rows, u)
    count = after - first
    # the width is about as uncertain as the place
    squares = np.stack([estimate.skew_sigma, estimate.sigma]) ** 2
    averaged = np.stack([estimate.skew, estimate.width, *squares])
    skew, width, skew_square, width_square = _mean(averaged, first, after)
    lean = np.maximum(np.abs(skew) - _CERTAIN * np.sqrt(skew_square / count), 0.0)
    usual = usual_width(estimate.width)
    width_sigma = np.sqrt(width_square / count) / usual
    change = np.abs(width / usual - 1.0) - _BEND - _CERTAIN * width_sigma
    least = least or 1e-3
    scale = np.maximum(np.maximum(estimate.width, usual), least)
    misfit = np.sqrt(np.maximum(estimate.misfit**2 - 1.0, 0.0))
    # a stripe of another width that is a clean bell lies on another face
    suspect = np.minimum(_ALWAYS + lean / _SUSPECT + misfit, 1.0)
    change = np.maximum(change, 0.0) * suspect
    narrow = np.maximum(1.0 - width / least, 0.0)
    parts = (
        _BY_SKEW * lean,
        _BY_MISFIT * misfit,
        _BY_WIDTH * change,
        _BY_NARROW * narrow,
    )
    moved = np.maximum(estimate.moved - _MOVED_SHARE * scale - _MOVED, 0.0)
    return np.asarray(np.sqrt(scale**2 * sum(part**2 for part in parts) + moved**2))


def usual_width(width: Widths) -> Widths:
    """Return the median width over the rows around each, told from every fourth row."""
    if not len(width):
        return width
    few = width[::_EVERY]
    half = min(_USUAL // _EVERY, (len(few) - 1) // 2)
    # for a few hundred values this takes a third of the time of scipy's median_filter
    ends = np.repeat(few[[0, -1]], half)
    around = sliding_window_view(np.concatenate([ends[:half], few, ends[half:]]), 2 * half + 1)
    medians = np.partition(around, half, axis=1)[:, half]
    return np.asarray(np.repeat(medians, _EVERY)[: len(width)])


def _neighbours(rows: Ints, u: Floats) -> tuple[Ints, Ints]:
    """Return for each point the first, and one after the last, of those near it on its piece."""
    starts = piece_starts(rows, u)
    piece = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    index = np.arange(len(rows))
    return (
        np.maximum(index - _NEAR, starts[piece]),
        np.minimum(index + _NEAR + 1, starts[piece + 1]),
    )


def piece_starts(rows: Ints, u: Floats) -> Ints:
    """Return where each unbroken piece of the stripe starts, and at the end its length."""
    gap = np.diff(rows)
    broken = (gap > _GAP) | (np.abs(np.diff(u)) > _SLOPE * gap)
    return np.concatenate([[0], np.flatnonzero(broken) + 1, [len(rows)]])


def _mean(values: Floats, first: Ints, after: Ints) -> Floats:
    """Return the means of (k, n) values over the neighbours of each, (k, n)."""
    total = np.zeros((len(values), values.shape[1] + 1))
    np.cumsum(values, axis=1, out=total[:, 1:])
    return np.asarray((total[:, after] - total[:, first]) / (after - first))
