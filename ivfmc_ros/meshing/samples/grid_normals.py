# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Tangents and normals of range grids, from connected neighbors along rows and columns."""

import numpy as np

from ivfmc_ros.meshing.samples.range_grid import median_spacings
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats

_MAX_STEPS = 8  # rows or columns to either side from which a tangent is computed


def grid_normals(points_xyz: Floats, to_camera: Floats, down: Bools, right: Bools) -> Floats:
    """
    Return (rows, columns, 3) unit normals on the side of the camera; NaN where unknown.

    points_xyz : (rows, columns, 3) meters, NaN where there is no point
    to_camera : unit vectors to the camera, broadcastable to the points
    down, right : (rows, columns) bool, the point in the next row, or column, is connected
    """
    spacings = median_spacings(points_xyz)
    ratio = spacings[1] / spacings[0] if np.isfinite(spacings).all() else 1.0
    # tangents of equal length both ways, so that they are equally accurate
    rows, columns = (max(1, min(_MAX_STEPS, round(r))) for r in (ratio, 1.0 / ratio))
    normals = np.cross(
        grid_tangents(points_xyz, down, 0, rows), grid_tangents(points_xyz, right, 1, columns)
    )
    normals *= np.copysign(1.0, (normals * to_camera).sum(axis=2, keepdims=True))
    with np.errstate(invalid='ignore', divide='ignore'):
        normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    return np.asarray(normals)


def grid_tangents(points: Floats, connected: Bools, axis: int, max_steps: int) -> Floats:
    """Return the vectors from the farthest connected point behind to the farthest ahead."""
    ahead, behind = points, points
    reaches_ahead = np.ones(connected.shape, dtype=bool)
    reaches_behind = reaches_ahead.copy()
    for step in range(1, max_steps + 1):
        reaches_ahead = reaches_ahead & np.roll(connected, -(step - 1), axis=axis)
        reaches_behind = reaches_behind & np.roll(connected, step, axis=axis)
        ahead = np.where(reaches_ahead[..., None], np.roll(points, -step, axis=axis), ahead)
        behind = np.where(reaches_behind[..., None], np.roll(points, step, axis=axis), behind)
    return np.asarray(ahead - behind)
