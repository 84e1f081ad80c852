# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Curvature of the surface along the rows of a range grid.

Parabolas are fitted to the points by their column number (Savitzky & Golay 1964): with the
derivatives p' and p'' by it, the curvature along the row is -p''.n / |p'|^2, whatever the spacing
of the columns. The windows are as long as the light sheet is thick, so that near the table axis,
where columns lie within the noise of one another, they hold more columns.
"""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.signal import savgol_coeffs

from ivfmc_ros.meshing.samples.connected_runs import ConnectedRuns
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints

_HALF_WIDTHS = (2, 3, 4, 6, 9, 14, 20)  # columns of the windows to each side
# Half length of the stretch of surface whose curvature counts, sigmas of the sheet.
_SHEET_SIGMAS = 3.0
_ROWS = 7  # to each side, over which the curvature is averaged on one surface
_MIN_ROWS = 6  # of them, with a window
_SMOOTH_COSINE = 0.8  # between neighboring normals down a column: one surface (37 degrees)
# Turn of the surface from the middle of a window to its end, radians, that is an edge.
_EDGE_TURN = 0.5
_ZERO = 1e-18  # square meters, between points at one place


@dataclass(frozen=True, eq=False, kw_only=True)
class RowCurvature:
    """
    Curvature along the rows, 1/meter, positive where the surface is convex; (rows, columns).

    value : mean over some rows; 0 where it is not known
    known : bool
    local : greatest magnitude between a point and its two neighbors, with all its noise
    """

    value: Floats
    known: Bools
    local: Floats


def row_curvature(
    points: Floats, normals: Floats, right: Bools, down: Bools, thickness: float
) -> RowCurvature:
    """
    Return the curvature of a range grid along its rows.

    points, normals : (rows, columns, 3), meters and unit on the side of the camera; NaN where
        there is none
    right, down : (rows, columns) bool, the next column, or row, is connected; the last column to
        the first
    thickness : meters, 1 sigma of the light sheet
    """
    normals = np.nan_to_num(normals)
    runs = ConnectedRuns.of(right, _HALF_WIDTHS[-1])
    widths = _half_widths(points, right, runs, _SHEET_SIGMAS * thickness)
    turn, square = np.zeros(right.shape), np.zeros(right.shape)
    solid = np.nan_to_num(points)
    for width in np.unique(widths).tolist():
        chosen = widths == width
        first, second = (_derivative(solid, width, order) for order in (1, 2))
        turn[chosen] = -(second[chosen] * normals[chosen]).sum(axis=1)
        square[chosen] = (first[chosen] ** 2).sum(axis=1)
    smooth_down = down & ((normals * np.roll(normals, -1, axis=0)).sum(axis=2) > _SMOOTH_COSINE)
    complete = (runs.reach >= widths) & (square > _ZERO)
    mean, count = _mean_over_rows(turn * complete, square * complete, complete, smooth_down)
    edge = complete & (np.abs(mean) * np.sqrt(square) * widths > _EDGE_TURN)
    good = complete & (count >= _MIN_ROWS) & ~_near(edge, widths)
    value, known = _continued(mean, good, right & ~edge & ~np.roll(edge, -1, axis=1))
    return RowCurvature(value=value, known=known, local=_local(points, normals, right))


def _half_widths(points: Floats, right: Bools, runs: ConnectedRuns, half_length: float) -> Ints:
    """Return (rows, columns) the half width of each point's window: an entry of the list."""
    step = np.linalg.norm(np.roll(points, -1, axis=1) - points, axis=2)
    total, count = (
        ndimage.uniform_filter1d(values, 2 * _HALF_WIDTHS[0] + 1, axis=1, mode='wrap')
        for values in (np.where(right, step, 0.0), right.astype(np.float64))
    )
    spacing = np.maximum(total, 1e-9) / np.maximum(count, 1e-9)
    # a longer window than half of the run would fit nowhere in it
    wanted = np.minimum(np.ceil(half_length / spacing), (runs.last - runs.first) // 2)
    place = np.searchsorted(_HALF_WIDTHS, wanted, side='right') - 1
    return np.asarray(np.array(_HALF_WIDTHS)[np.maximum(place, 0)])


def _derivative(points: Floats, width: int, order: int) -> Floats:
    """Return a derivative of the points by the column number, from windows of a half width."""
    kernel = savgol_coeffs(2 * width + 1, 2, deriv=order, use='dot')
    return np.asarray(ndimage.correlate1d(points, kernel, axis=1, mode='wrap'))


def _mean_over_rows(
    turn: Floats, square: Floats, complete: Bools, down: Bools
) -> tuple[Floats, Floats]:
    """Return the mean curvature of the complete windows of some rows, and their number."""
    runs = ConnectedRuns.of(np.append(down[:-1], np.zeros_like(down[:1]), axis=0).T, _ROWS)
    columns = np.arange(turn.shape[1])
    sums = []
    for values in (turn, square, complete.astype(np.float64)):
        total = np.cumsum(np.pad(values, ((1, 0), (0, 0))), axis=0)
        sums.append(total[runs.last.T + 1, columns] - total[runs.first.T, columns])
    return sums[0] / np.maximum(sums[1], _ZERO), sums[2]


def _near(edge: Bools, widths: Ints) -> Bools:
    """Return which points lie in the windows of edges."""
    near = edge.copy()
    for width in _HALF_WIDTHS:
        near |= ndimage.maximum_filter1d(edge & (widths == width), 2 * width + 1, 1, mode='wrap')
    return near


def _continued(mean: Floats, good: Bools, right: Bools) -> tuple[Floats, Bools]:
    """Return the values of good points, continued to the ends of their runs, and where."""
    runs = ConnectedRuns.of(right, _HALF_WIDTHS[-1])
    rows, count = np.arange(len(good))[:, None], good.shape[1]
    own = np.arange(count)
    place = np.where(np.tile(good, 3), np.arange(3 * count), -1)
    before = np.maximum.accumulate(place, axis=1)[:, count : 2 * count] - count
    place = np.where(np.tile(good, 3), np.arange(3 * count), 3 * count)
    after = np.minimum.accumulate(place[:, ::-1], axis=1)[:, ::-1][:, count : 2 * count] - count
    has_before, has_after = before >= runs.first, after <= runs.last
    nearer_before = has_before & (~has_after | (own - before <= after - own))
    source = np.where(nearer_before, before, after)
    known = good | has_before | has_after
    return np.where(known, mean[rows, source % count], 0.0), known


def _local(points: Floats, normals: Floats, right: Bools) -> Floats:
    step = np.roll(points, -1, axis=1) - points
    bend = ((np.roll(normals, -1, axis=1) - normals) * step).sum(axis=2)
    raw = np.where(right, np.abs(bend) / np.maximum((step * step).sum(axis=2), _ZERO), 0.0)
    return np.maximum(raw, np.roll(raw, 1, axis=1))
