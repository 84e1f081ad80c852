# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Selection of one peak per row by a minimum-cost path along the stripe (dynamic programming).

A reflection or a second stripe is often brighter than the true one, but it is wider, or jumps
where it begins and ends. The costs are those of width, height and jumps (similar to the gap
repair of Usamentiaga, Molleda, Garcia 2012, Sensors 12). The recursion over rows is a min-plus
product of (candidates x candidates) matrices; the product is associative and is therefore
computed by doubling (parallel prefix), vectorized over all rows.
"""

import numpy as np

from ivfmc_ros.model import Bools
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Singles
from ivfmc_ros.stripe.peaks import Peaks

# Costs, without unit. A peak half as high as the highest of its row costs 0.07, one 1.35 times
# as wide as expected 0.5, a jump 12: a jump pays only if it avoids many bad rows.
_HEIGHT_COST = 0.1
_WIDTH_COST = 0.5
# Scale of the logarithm of a width ratio, and the upper limit of its cost.
_WIDTH_SCALE = 0.3
_MAX_WIDTH_COST = 2.0
_JUMP_COST = 12.0
# A jump: more pixels per row than a slope of this, plus the error of a detected column, pixels.
_MAX_SLOPE = 4.0
_COLUMN_ERROR = 3.0
# Cost of a sudden change of height from row to row by a factor of e or more.
_HEIGHT_CHANGE_COST = 1.0
_INFINITE_COST = np.float32(1e6)
# Rows with a single peak from which the expected width is estimated; else from all rows.
_MIN_SINGLE_ROWS = 20


def select_peaks(peaks: Peaks) -> Ints:
    """
    Select the peak of the stripe in each row, (rows,) int64 indices; -1 where there is none.

    peaks : arrays (rows, candidates), the highest_peaks first
    """
    chosen = highest_peaks(peaks)
    found = peaks.found
    if not found[:, 1:].any():
        return chosen
    ambiguous: Bools = found.sum(axis=1) > 1
    if not ambiguous.any():
        return chosen
    rows = _with_neighbors(ambiguous, chosen >= 0)
    local = peaks[rows]
    width = peaks.width[:, 0]
    single = width[found[:, 0] & ~ambiguous]
    widths = single if len(single) >= _MIN_SINGLE_ROWS else width[found[:, 0]]
    expected = np.partition(widths, len(widths) // 2)[len(widths) // 2]
    node_costs = _node_costs(local, float(expected))
    transitions = _transition_costs(local, rows) + node_costs.T[None, :, 1:]
    forward = path_costs(node_costs[0], transitions)
    backward = path_costs(
        np.zeros(node_costs.shape[1], np.float32), transitions[..., ::-1].swapaxes(0, 1)
    )
    chosen[rows] = (forward + backward[:, ::-1]).argmin(axis=0)
    return chosen


def highest_peaks(peaks: Peaks) -> Ints:
    """Return the highest_peaks peak of each row, (rows,) int64; -1 where there is none."""
    found = peaks.found
    index = np.full(len(found), -1)
    for k in reversed(range(found.shape[1])):
        index[found[:, k]] = k
    return index


def _with_neighbors(ambiguous: Bools, any_found: Bools) -> Ints:
    """Return rows with several peaks, and the next rows with a peak before and after each."""
    rows = np.flatnonzero(any_found)
    inner = ambiguous[rows]
    selected = inner.copy()
    selected[1:] |= inner[:-1]
    selected[:-1] |= inner[1:]
    return np.asarray(rows[selected])


def _node_costs(peaks: Peaks, expected: float) -> Singles:
    """Return the cost of each peak by itself, (rows, candidates)."""
    height = np.where(peaks.found, peaks.height, 1.0)
    height_cost = _HEIGHT_COST * np.log(
        height.max(axis=1, keepdims=True) / np.maximum(height, 1e-3)
    )
    stretch = np.log(np.where(peaks.found, peaks.width, expected) / expected) / _WIDTH_SCALE
    cost = height_cost + np.minimum(_WIDTH_COST * stretch**2, _MAX_WIDTH_COST)
    return np.where(peaks.found, cost, _INFINITE_COST).astype(np.float32)


def _transition_costs(peaks: Peaks, rows: Ints) -> Singles:
    """Return the transition cost from peak a of a row to peak b of the next, (a, b, rows - 1)."""
    column = (peaks.column + np.where(peaks.found, peaks.middle, 0.0)).T
    height = np.log(np.where(peaks.found, np.maximum(peaks.height, 1.0), 1.0)).T
    allowed = _MAX_SLOPE * np.diff(rows) + _COLUMN_ERROR
    move = np.abs(column[None, :, 1:] - column[:, None, :-1]) / allowed
    height_change = np.minimum(np.abs(height[None, :, 1:] - height[:, None, :-1]), 1.0)
    return np.asarray(
        _JUMP_COST * np.minimum(move**2, 1.0) + _HEIGHT_CHANGE_COST * height_change,
        dtype=np.float32,
    )


def path_costs(start: Singles, steps: Singles) -> Singles:
    """
    Return the minimum cost of a path from the first row to each peak of each row.

    start : (candidates,) cost in the first row; steps : (a, b, rows - 1)
    returns : (candidates, rows)
    """
    product = steps.copy()
    span = 1
    while span < product.shape[2]:
        product[..., span:] = _min_plus(product[..., :-span], product[..., span:])
        span *= 2
    ends = np.min(start[:, None, None] + product, axis=0)
    return np.concatenate([start[:, None], ends], axis=1)


def _min_plus(a: Singles, b: Singles) -> Singles:
    """Return the min-plus product of matrices (i, k, n) and (k, j, n)."""
    best = a[:, 0, None] + b[None, 0]
    for k in range(1, a.shape[1]):
        np.minimum(best, a[:, k, None] + b[None, k], out=best)
    return np.asarray(best)
