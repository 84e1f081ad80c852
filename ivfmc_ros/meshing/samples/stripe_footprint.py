# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Systematic error of stripe points, from the surface under the full width of the light sheet.

A stripe is located by the center of its profile across the light sheet. The center is right where
the whole width of the sheet falls on one smooth surface that the camera sees. Where an edge, a
shadow, an occlusion or a crease cuts the profile, its center is biased by up to the thickness of
the sheet. The bias is the same in every picture and in neighboring points: no mean removes it.

The surface under the flanks of the sheet was measured at neighboring table angles: in the frame of
the part it holds the neighbors of a point in its image row.
"""

import numpy as np
from scipy.stats import norm

from ivfmc_ros.meshing.samples.connected_runs import ConnectedRuns
from ivfmc_ros.meshing.samples.range_grid import RangeGrid
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints

# Neighboring normals that differ by more are on two faces (cosine; 20 degrees).
_SMOOTH_COSINE = np.cos(np.radians(20.0))
# Greatest turn of the table over which neighbors are searched, radians: beyond, the distance from
# the sheet does not grow any more.
_MAX_TURN = np.radians(60.0)
# Rows to each side in which the stripe must go on.
_MIN_ROWS = 2
# Margin without a neighbor, sigmas of the sheet: half of the profile may be missing.
_NO_MARGIN = 0.0
# Least cosine between the line of sight and the normal of the sheet.
_MIN_ACROSS = 0.05


def systematic_sigma(grid: RangeGrid, normals: Floats, down: Bools, right: Bools) -> Floats:
    """
    Return 1 sigma of the systematic error of each point along its normal, (rows, columns) meters.

    It is the shift of the center of a Gaussian profile that ends at the border of the surface,
    phi(m) / Phi(m) sigma at m sigmas from the center, seen along the line of sight.

    grid : with ``sheet_normals``; without them or without ``thickness`` the result is NaN
    normals : (rows, columns, 3) unit, NaN where unknown
    down, right : (rows, columns) bool, the point in the next row, or column, is connected
    """
    if grid.sheet_normals is None or not grid.thickness:
        return np.full(normals.shape[:2], np.nan)
    margin = footprint_margin(grid, normals, down, right)
    shift = norm.pdf(margin) / norm.cdf(margin) * grid.thickness
    across = np.abs((grid.to_camera * grid.sheet_normals).sum(axis=2))
    facing = np.abs((grid.to_camera * np.nan_to_num(normals)).sum(axis=2))
    return np.asarray(shift * facing / np.maximum(across, _MIN_ACROSS))


def footprint_margin(grid: RangeGrid, normals: Floats, down: Bools, right: Bools) -> Floats:
    """
    Return how far the smooth surface around each point goes on across the sheet.

    returns : (rows, columns) in sigmas of the sheet, the shorter of both sides
    """
    known = np.isfinite(normals[..., 0])
    after = np.roll(normals, -1, axis=1)
    with np.errstate(invalid='ignore'):
        smooth = (normals * after).sum(axis=2) > _SMOOTH_COSINE
    right = right & known & np.roll(known, -1, axis=1) & smooth
    runs = ConnectedRuns.of(right, _steps(grid))
    margin = np.minimum(_distance(grid, runs.last), _distance(grid, runs.first))
    inner = known & _inside_rows(down)
    return np.where(inner, margin / grid.thickness, _NO_MARGIN)


def _steps(grid: RangeGrid) -> int:
    """Return the number of columns of the greatest turn."""
    columns = grid.points_xyz.shape[1]
    step = max(grid.angle_step, 2.0 * np.pi / 1e6)
    return int(np.clip(np.ceil(_MAX_TURN / step), 1, max(columns - 1, 1)))


def _distance(grid: RangeGrid, columns: Ints) -> Floats:
    """Return the distances of other points in the rows from the sheet of each point, meters."""
    points = grid.points_xyz
    rows = np.arange(points.shape[0])[:, None]
    step = points[rows, columns % points.shape[1]] - points
    return np.asarray(np.abs(np.nan_to_num((step * grid.sheet_normals).sum(axis=2))))


def _inside_rows(down: Bools) -> Bools:
    """Return which points have ``_MIN_ROWS`` connected rows before and after them."""
    inside = np.ones(down.shape, dtype=bool)
    up = np.roll(down, 1, axis=0)
    for step in range(_MIN_ROWS):
        inside &= np.roll(down, -step, axis=0) & np.roll(up, step, axis=0)
    return inside
