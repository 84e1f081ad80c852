# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Detection of truncated stripe ends: points that are not on the line of the points before them.

Where a stripe ends at an edge or a shadow, half of its width may be missing. The center of the
rest lies off the surface, mostly in front of it. The end of a run of points is therefore accepted
only if it continues the straight line through the points before it.
"""

import numpy as np

from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints

_LINE_POINTS = 5  # before an end, to which the line is fitted
_MAX_SIGMAS = 3.0  # distance of an accepted end from the line, in its 1 sigma
_MAX_ITERATIONS = 3  # of removing ends
# Positions along the line, in rows from the center of the points before the end; and of the end.
_STEPS: Floats = np.arange(float(_LINE_POINTS)) - 0.5 * (_LINE_POINTS - 1)
_END = 0.5 * (_LINE_POINTS + 1)
# 1 sigma of the distance between end and line, in units of 1 sigma of a point: that of the end,
# and that of a line fitted to the others and extrapolated to it.
_EXTRAPOLATION = float(np.sqrt(1.0 + 1.0 / _LINE_POINTS + _END**2 / (_STEPS**2).sum()))


def truncated_ends(points: Floats, down: Bools, sigma: float) -> Bools:
    """
    Return which points are at the end of a stripe and off the line of the points before them.

    Of runs too short to fit a line, both ends are returned.

    points : (rows, columns, 3) meters, NaN where there is no point
    down : (rows, columns) bool, the point in the next row is on the same surface
    sigma : meters, median 1 sigma of all points
    returns : (rows, columns) bool
    """
    left = np.isfinite(points[..., 0])
    for iteration in range(_MAX_ITERATIONS):
        connected = down & left & np.roll(left, -1, axis=0)
        short = iteration == 0
        truncated = _judge_ends(points, left, connected, 1, sigma, reject_short=short)
        truncated |= _judge_ends(points, left, connected, -1, sigma, reject_short=short)
        if not truncated.any():
            break
        left &= ~truncated
    return np.asarray(np.isfinite(points[..., 0]) & ~left)


def run_ends(left: Bools, down: Bools) -> Bools:
    """
    Return which points are the first or the last of a run of connected points in a column.

    left : (rows, columns) bool, there is a point
    down : (rows, columns) bool, the point in the next row is on the same surface
    returns : (rows, columns) bool
    """
    after = down & left & np.roll(left, -1, axis=0)
    before = np.roll(after, 1, axis=0)
    before[0] = False
    return np.asarray(left & ~(after & before))


def _judge_ends(
    points: Floats,
    left: Bools,
    connected: Bools,
    direction: int,
    sigma: float,
    *,
    reject_short: bool,
) -> Bools:
    """Return the truncated ends whose run goes on to later rows (direction 1) or earlier (-1)."""
    before = np.roll(connected, 1, axis=0)
    before[0] = False
    inward, outward = (connected, before) if direction > 0 else (before, connected)
    row, column = np.nonzero(left & ~outward)
    long = np.ones(len(row), dtype=bool)
    for step in range(_LINE_POINTS):
        at = np.clip(row + direction * step, 0, len(points) - 1)
        long &= inward[at, column]
    truncated = np.zeros(left.shape, dtype=bool)
    if reject_short:
        truncated[row[~long], column[~long]] = True
    row, column = row[long], column[long]
    distance = _line_distance(points, row, column, direction)
    far = distance > _MAX_SIGMAS * _EXTRAPOLATION * sigma
    truncated[row[far], column[far]] = True
    return truncated


def _line_distance(points: Floats, row: Ints, column: Ints, direction: int) -> Floats:
    """Return (n,) meters, distance of ends from the line through the points before them."""
    rows = row[:, None] + direction * np.arange(1, _LINE_POINTS + 1)
    run = points[rows, column[:, None]]
    center = run.mean(axis=1)
    slope = (_STEPS[None, :, None] * (run - center[:, None])).sum(axis=1)
    slope /= np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-30)
    step = points[row, column] - center
    return np.asarray(
        np.linalg.norm(step - (step * slope).sum(axis=1, keepdims=True) * slope, axis=1)
    )
