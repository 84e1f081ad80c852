# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
One path along the stripe through the peaks of all rows.

A reflection or a second stripe is often brighter than the true one, but it is wider or jumps
where it begins and ends. The path of least cost is found by dynamic programming (Usamentiaga,
Molleda, Garcia 2012, Sensors 12, repair gaps of stripes with like terms). The recursion over
rows is a product of (candidates x candidates) matrices in which + is min and * is +. That
product is associative, so that it is built by doubling, for all rows at once.
"""

import numpy as np

from ivfmc_ros.model import Bools
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Singles
from ivfmc_ros.stripe.peaks import Peaks

# Costs. A peak twice as dim as the brightest of its row costs 0.07, one that is 1.35 times as
# wide as expected 0.5, a jump 12: a stripe has to be wrong for long before a jump pays.
_DIM = 0.1
_WIDE = 0.5
_WIDTH_SPREAD = 0.3
_WIDEST = 2.0
_JUMP = 12.0
# A stripe that moves by so many pixels a row, and more by its rough measurement, jumps.
_SLOPE = 4.0
_ROUGH = 3.0
# Brightness changes along a stripe, but seldom at once.
_FLICKER = 1.0
_NEVER = np.float32(1e6)
# So many rows with one peak are enough to tell the stripe's width.
_ENOUGH = 20


def choose(peaks: Peaks) -> Ints:
    """
    Return which peak of each row is the stripe, (rows,) int64; -1 where there is none.

    peaks : arrays (rows, candidates), the brightest first
    """
    chosen = brightest(peaks)
    found = peaks.found
    if not found[:, 1:].any():
        return chosen
    rivals: Bools = found.sum(axis=1) > 1
    if not rivals.any():
        return chosen
    rows = _around(rivals, chosen >= 0)
    local = peaks[rows]
    width = peaks.width[:, 0]
    single = width[found[:, 0] & ~rivals]
    widths = single if len(single) >= _ENOUGH else width[found[:, 0]]
    expected = np.partition(widths, len(widths) // 2)[len(widths) // 2]
    unary = _unary(local, float(expected))
    pairs = _pairs(local, rows) + unary.T[None, :, 1:]
    forward = _forward(unary[0], pairs)
    backward = _forward(np.zeros(unary.shape[1], np.float32), pairs[..., ::-1].swapaxes(0, 1))
    chosen[rows] = (forward + backward[:, ::-1]).argmin(axis=0)
    return chosen


def brightest(peaks: Peaks) -> Ints:
    """Return the brightest peak of each row, (rows,) int64; -1 where there is none."""
    found = peaks.found
    index = np.full(len(found), -1)
    for k in reversed(range(found.shape[1])):
        index[found[:, k]] = k
    return index


def _around(rivals: Bools, any_found: Bools) -> Ints:
    """Return rows with rivals, and the next rows with a peak before and after each."""
    rows = np.flatnonzero(any_found)
    inner = rivals[rows]
    wanted = inner.copy()
    wanted[1:] |= inner[:-1]
    wanted[:-1] |= inner[1:]
    return np.asarray(rows[wanted])


def _unary(peaks: Peaks, expected: float) -> Singles:
    """Return the cost of each peak by itself, (rows, candidates)."""
    height = np.where(peaks.found, peaks.height, 1.0)
    dim = _DIM * np.log(height.max(axis=1, keepdims=True) / np.maximum(height, 1e-3))
    stretch = np.log(np.where(peaks.found, peaks.width, expected) / expected) / _WIDTH_SPREAD
    cost = dim + np.minimum(_WIDE * stretch**2, _WIDEST)
    return np.where(peaks.found, cost, _NEVER).astype(np.float32)


def _pairs(peaks: Peaks, rows: Ints) -> Singles:
    """Return the cost of going from peak a of a row to peak b of the next, (a, b, rows - 1)."""
    place = (peaks.column + np.where(peaks.found, peaks.middle, 0.0)).T
    height = np.log(np.where(peaks.found, np.maximum(peaks.height, 1.0), 1.0)).T
    allowed = _SLOPE * np.diff(rows) + _ROUGH
    move = np.abs(place[None, :, 1:] - place[:, None, :-1]) / allowed
    flicker = np.minimum(np.abs(height[None, :, 1:] - height[:, None, :-1]), 1.0)
    return np.asarray(_JUMP * np.minimum(move**2, 1.0) + _FLICKER * flicker, dtype=np.float32)


def _forward(start: Singles, steps: Singles) -> Singles:
    """
    Return the least cost of a path from the first row to each peak of each row.

    start : (candidates,) cost in the first row; steps : (a, b, rows - 1)
    returns : (candidates, rows)
    """
    product = steps.copy()
    span = 1
    while span < product.shape[2]:
        product[..., span:] = _product(product[..., :-span], product[..., span:])
        span *= 2
    ends = np.min(start[:, None, None] + product, axis=0)
    return np.concatenate([start[:, None], ends], axis=1)


def _product(a: Singles, b: Singles) -> Singles:
    """Return the min-plus product of matrices (i, k, n) and (k, j, n)."""
    best = a[:, 0, None] + b[None, 0]
    for k in range(1, a.shape[1]):
        np.minimum(best, a[:, k, None] + b[None, k], out=best)
    return np.asarray(best)
