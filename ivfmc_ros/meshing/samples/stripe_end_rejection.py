# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Stripes that an edge cuts off are found beside where they are.

Where a stripe ends, at an edge or in a shadow, half of its width may be missing: the middle of
what is left lies off the surface, mostly before it. The end of a run of points is therefore
believed only if it goes on as the points behind it do.
"""

import numpy as np

from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints

_BEHIND = 5  # points that tell how a run goes on
_MOST_OFF = 3.0  # sigmas
_ROUNDS = 3
# The points behind an end, counted from their middle, and the end itself.
_STEPS: Floats = np.arange(float(_BEHIND)) - 0.5 * (_BEHIND - 1)
_END = 0.5 * (_BEHIND + 1)
# 1 sigma of the end from a line through those behind, in sigmas of a point
_SPREAD = float(np.sqrt(1.0 + 1.0 / _BEHIND + _END**2 / (_STEPS**2).sum()))


def cut_ends(points: Floats, down: Bools, sigma: float) -> Bools:
    """
    Tell which points are at the end of a stripe and do not go on as it does.

    Runs that are too short to tell lose both of their ends.

    points : (rows, columns, 3) metres, NaN where nothing is
    down : (rows, columns), the point in the next row is on the same surface
    sigma : metres, of a usual point
    returns : (rows, columns) bool
    """
    left = np.isfinite(points[..., 0])
    for turn in range(_ROUNDS):
        linked = down & left & np.roll(left, -1, axis=0)
        cut = _cut(points, left, linked, 1, sigma, short=turn == 0)
        cut |= _cut(points, left, linked, -1, sigma, short=turn == 0)
        if not cut.any():
            break
        left &= ~cut
    return np.asarray(np.isfinite(points[..., 0]) & ~left)


def run_ends(left: Bools, down: Bools) -> Bools:
    """
    Tell which points are the first or the last of a run.

    left : (rows, columns), there is a point; down : it and that in the next row are linked
    """
    after = down & left & np.roll(left, -1, axis=0)
    before = np.roll(after, 1, axis=0)
    before[0] = False
    return np.asarray(left & ~(after & before))


def _cut(
    points: Floats, left: Bools, linked: Bools, sense: int, sigma: float, *, short: bool
) -> Bools:
    """Judge the ends from which a run goes on to later rows (sense 1) or to earlier ones (-1)."""
    before = np.roll(linked, 1, axis=0)
    before[0] = False
    inward, outward = (linked, before) if sense > 0 else (before, linked)
    row, column = np.nonzero(left & ~outward)
    long = np.ones(len(row), dtype=bool)
    for step in range(_BEHIND):
        at = np.clip(row + sense * step, 0, len(points) - 1)
        long &= inward[at, column]
    cut = np.zeros(left.shape, dtype=bool)
    if short:
        cut[row[~long], column[~long]] = True
    row, column = row[long], column[long]
    off = _off_line(points, row, column, sense)
    far = off > _MOST_OFF * _SPREAD * sigma
    cut[row[far], column[far]] = True
    return cut


def _off_line(points: Floats, row: Ints, column: Ints, sense: int) -> Floats:
    """Return (n,) metres of ends from the line through the points behind them."""
    behind = row[:, None] + sense * np.arange(1, _BEHIND + 1)
    run = points[behind, column[:, None]]
    middle = run.mean(axis=1)
    slope = (_STEPS[None, :, None] * (run - middle[:, None])).sum(axis=1)
    slope /= np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-30)
    step = points[row, column] - middle
    return np.asarray(
        np.linalg.norm(step - (step * slope).sum(axis=1, keepdims=True) * slope, axis=1)
    )
