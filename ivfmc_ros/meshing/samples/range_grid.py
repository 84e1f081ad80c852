# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Range grids: organized point clouds of single views, with the geometry of their acquisition."""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import View
from ivfmc_ros.registration.views.assemble import is_full_turn

# Neighbors on one surface are at most so many median spacings apart: the spacing on a surface
# that is inclined by 80 degrees.
_MAX_STRETCH = 6.0
# Neighbors nearer than this (meters) are one place, which the table passed twice.
_SAME_PLACE = 1e-9
# A step at a smaller angle to the line of sight (cosine; 14 degrees) is a jump, not a surface.
_MAX_ALONG_SIGHT = 0.97


@dataclass(frozen=True, eq=False, kw_only=True)
class RangeGrid:
    """
    An organized point cloud with its viewing directions.

    points_xyz : (rows, columns, 3) meters; NaN where there is no point
    to_camera : unit vectors from the points to the camera, broadcastable to (rows, columns, 3)
    error_direction : unit vectors along which the points err, likewise; None for ``to_camera``
    sigma : (rows, columns) meters, 1 sigma along the error direction
    intensity : (rows, columns) gray values
    closed : the last column neighbors the first
    thickness : meters, 1 sigma of the light sheet; 0 if unknown
    sheet_normals : (columns, 3) unit normals of the light sheet, or None
    angle_step : radians, median step between columns
    """

    points_xyz: Floats
    to_camera: Floats
    sigma: Floats
    intensity: Floats
    error_direction: Floats | None = None
    closed: bool = False
    thickness: float = 0.0
    sheet_normals: Floats | None = None
    angle_step: float = 0.0


def make_range_grid(cell: Cell, view: View, turntable_from_view: Floats) -> RangeGrid:
    """
    Return the range grid of a view in ``turntable``.

    turntable_from_view : (4, 4), pose of the view
    """
    R = turntable_from_view[:3, :3]
    turns = np.swapaxes(transforms.rotation_z(-view.angles), 1, 2)
    points = transforms.apply(turntable_from_view, view.points_xyz.reshape(-1, 3))
    points = points.reshape(view.points_xyz.shape)
    cameras = (cell.turntable.to_part(np.zeros((1, 3)), 0.0) @ turns)[:, 0]
    cameras = transforms.apply(turntable_from_view, cameras)
    to_camera = cameras[None] - points
    to_camera /= np.linalg.norm(to_camera, axis=2, keepdims=True)
    error = np.swapaxes(_error_directions(cell, view) @ turns, 0, 1)
    return RangeGrid(
        points_xyz=points,
        to_camera=to_camera,
        sigma=view.sigma,
        intensity=view.intensity,
        error_direction=error @ R.T,
        closed=is_full_turn(view),
        thickness=cell.lasers[view.laser].thickness,
        sheet_normals=_sheet_normals(cell, view, turns) @ R.T,
        angle_step=float(np.median(np.diff(view.angles))) if len(view.angles) > 1 else 0.0,
    )


def _sheet_normals(cell: Cell, view: View, turns: Floats) -> Floats:
    """Return the normals of the light sheet in ``turntable``, (columns, 3)."""
    normal = cell.lasers[view.laser].normal @ cell.turntable.camera_from_base[:3, :3]
    return np.asarray(normal @ turns)


def _error_directions(cell: Cell, view: View) -> Floats:
    """Return dX/du of every stripe line as (lines, 3) unit vectors in ``turntable_base``."""
    laser, camera = cell.lasers[view.laser], cell.camera
    line = np.arange(view.points_xyz.shape[0], dtype=np.float64)
    if laser.stripe == 'rows':
        uv, along = np.stack([np.full(len(line), 0.5 * camera.width), line], axis=1), (1.0, 0.0)
    else:
        uv, along = np.stack([line, np.full(len(line), 0.5 * camera.height)], axis=1), (0.0, 1.0)
    ends = [camera.rays(uv + step * np.array(along)) for step in (-1.0, 1.0)]
    directions = np.cross(laser.normal, np.cross(ends[0], ends[1]))
    with np.errstate(invalid='ignore'):
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return np.asarray(directions @ cell.turntable.camera_from_base[:3, :3])


def median_spacings(points_xyz: Floats) -> tuple[float, float]:
    """
    Return the median distances of neighbors down the rows and across the columns.

    points_xyz : (rows, columns, 3) meters, NaN where there is no point
    returns : meters; NaN where there are no neighbors
    """
    steps = [np.linalg.norm(np.diff(points_xyz, axis=k), axis=2) for k in (0, 1)]
    known = [step[np.isfinite(step) & (step > _SAME_PLACE)] for step in steps]
    down, right = (float(np.median(step)) if step.size else float('nan') for step in known)
    return down, right


def _distance_limit(points: Floats, axis: int, max_edge: float | None) -> float:
    usual = _MAX_STRETCH * float(np.nan_to_num(median_spacings(points)[axis]))
    return usual if max_edge is None else min(usual, max_edge)


def connected_to_next(grid: RangeGrid, axis: int, max_edge: float | None) -> Bools:
    """
    Return (rows, columns) bool, whether the next point along ``axis`` is on the same surface.

    axis : 0 for the next row, 1 for the next column
    max_edge : meters, greatest distance; None for 6 median spacings only
    """
    points, limit = grid.points_xyz, _distance_limit(grid.points_xyz, axis, max_edge)
    step = np.roll(points, -1, axis=axis) - points
    with np.errstate(invalid='ignore'):
        length = np.linalg.norm(step, axis=2)
        connected = (length < limit) & (
            np.abs((step * grid.to_camera).sum(axis=2)) <= _MAX_ALONG_SIGHT * length
        )
    if axis == 0:
        connected[-1] = False
    elif not grid.closed:
        connected[:, -1] = False
    return np.asarray(connected)
