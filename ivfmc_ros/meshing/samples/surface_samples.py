# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Measured points as pieces of surface: each with a normal, a weight and how it was seen."""

from collections.abc import Iterable
from collections.abc import Iterator
from dataclasses import dataclass
from dataclasses import field as attribute
from dataclasses import fields
from dataclasses import replace

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.meshing.samples.thickness import inward
from ivfmc_ros.meshing.samples.thickness import Light
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import View
from ivfmc_ros.registration.views.assemble import closes

# The error of a point lies along the sheet; where the surface does too, this share remains.
_LEAST_ACROSS = 0.3
# Neighbours on the surface are at most this many median spacings apart (80 degrees from square).
_STRETCH = 6.0
_SAME_PLACE = 1e-9  # metres
# A step that follows the line of sight as much as this (cosine) is a jump and not a surface.
_ALONG_SIGHT = 0.97
# Between points that many voxels apart the surface is not interpolated.
_MOST_BETWEEN = 20
# A curve is laid through two points whose normals differ by less than this (cosine).
_SMOOTH = 0.8


@dataclass(frozen=True, eq=False, kw_only=True)
class Samples:
    """
    Points of a surface in ``turntable``.

    points_xyz : (n, 3) metres
    normals : (n, 3) unit, towards the eye
    sight : (n, 3) unit, towards the eye
    weight : (n,) 1/metre^2: 1/sigma^2 along the normal; interpolated points share that of theirs
    intensity : (n,) grey values
    alone_xyz : (k, 3) metres, points without a normal: they tell that there is surface, not where
    """

    points_xyz: Floats
    normals: Floats
    sight: Floats
    weight: Floats
    intensity: Floats
    alone_xyz: Floats = attribute(default_factory=lambda: np.empty((0, 3)))

    def __len__(self) -> int:
        return len(self.points_xyz)


@dataclass(frozen=True, eq=False, kw_only=True)
class RangeGrid:
    """
    An organised cloud and from where it was seen.

    points_xyz : (rows, columns, 3) metres; NaN where nothing is
    sight : unit vectors from the points to the eye, broadcast to (rows, columns, 3)
    error : unit vectors along which a point errs, likewise, or None: along the sight
    sigma, intensity : (rows, columns)
    closed : the last column neighbours the first
    thickness : metres, 1 sigma of the sheet of light; 0 where not known
    """

    points_xyz: Floats
    sight: Floats
    sigma: Floats
    intensity: Floats
    error: Floats | None = None
    closed: bool = False
    thickness: float = 0.0


def range_grid(cell: Cell, view: View, turntable_from_view: Floats) -> RangeGrid:
    """Return a view where its pose puts it, with what the cell knows of how it was seen."""
    R = turntable_from_view[:3, :3]
    turns = np.swapaxes(transforms.rotation_z(-view.angles), 1, 2)
    points = transforms.apply(turntable_from_view, view.points_xyz.reshape(-1, 3))
    points = points.reshape(view.points_xyz.shape)
    eyes = (cell.turntable.to_part(np.zeros((1, 3)), 0.0) @ turns)[:, 0]
    eyes = transforms.apply(turntable_from_view, eyes)
    sight = eyes[None] - points
    sight /= np.linalg.norm(sight, axis=2, keepdims=True)
    error = np.swapaxes(_error_directions(cell, view) @ turns, 0, 1)
    return RangeGrid(
        points_xyz=points,
        sight=sight,
        sigma=view.sigma,
        intensity=view.intensity,
        error=error @ R.T,
        closed=closes(view),
        thickness=cell.lasers[view.laser].thickness,
    )


def _error_directions(cell: Cell, view: View) -> Floats:
    """Return dX/du of every stripe line as (lines, 3) unit vectors in ``turntable_base``."""
    laser, camera = cell.lasers[view.laser], cell.camera
    line = np.arange(view.points_xyz.shape[0], dtype=np.float64)
    if laser.stripe == 'rows':
        uv, along = np.stack([np.full(len(line), 0.5 * camera.width), line], axis=1), (1.0, 0.0)
    else:
        uv, along = np.stack([line, np.full(len(line), 0.5 * camera.height)], axis=1), (0.0, 1.0)
    ends = [camera.rays(uv + step * np.array(along)) for step in (-1.0, 1.0)]
    across = np.cross(laser.normal, np.cross(ends[0], ends[1]))
    with np.errstate(invalid='ignore'):
        across /= np.linalg.norm(across, axis=1, keepdims=True)
    return np.asarray(across @ cell.turntable.camera_from_base[:3, :3])


def merge(parts: Iterable[Samples]) -> Samples:
    """Return all samples in one."""
    parts = list(parts)
    columns = {
        field.name: np.concatenate([getattr(part, field.name) for part in parts])
        for field in fields(Samples)
    }
    return Samples(**columns)


def from_grid(grid: RangeGrid, reach: float | None, voxel: float) -> Samples:
    """Return the points of a grid that have neighbours both ways, and some between columns."""
    down, right = links(grid, 0, reach), links(grid, 1, reach)
    normals = _normals(grid, down, right)
    grid = _outward(grid, normals, right)
    points = grid.points_xyz
    with np.errstate(invalid='ignore'):
        known = np.isfinite(normals[..., 0])
    weight = _weights(grid, normals)
    linked = right & known & np.roll(known, -1, axis=1)
    ends = _Ends.of(grid, linked, voxel)
    weight[ends.row, ends.column] /= ends.pieces
    whole = Samples(
        points_xyz=points[known],
        normals=normals[known],
        sight=np.broadcast_to(grid.sight, points.shape)[known],
        weight=weight[known],
        intensity=grid.intensity[known],
        alone_xyz=points[~known & np.isfinite(points[..., 0])],
    )
    return merge([whole, *_between(grid, normals, weight, ends)])


def _outward(grid: RangeGrid, normals: Floats, right: Bools) -> RangeGrid:
    """Return the grid with its points on curved surfaces where a thin sheet would have them."""
    if grid.error is None or not grid.thickness:
        return grid
    light = Light(sight=grid.sight, error=grid.error, thickness=grid.thickness)
    known = np.nan_to_num(normals)
    off = inward(grid.points_xyz, normals, right, light)
    return replace(grid, points_xyz=grid.points_xyz + off[..., None] * known)


def spacings(grid_points: Floats) -> tuple[float, float]:
    """Return the median steps down the rows and across the columns, metres; NaN if none."""
    steps = [np.linalg.norm(np.diff(grid_points, axis=k), axis=2) for k in (0, 1)]
    # where a table passes an angle twice, neighbours are at one place
    known = [step[np.isfinite(step) & (step > _SAME_PLACE)] for step in steps]
    down, right = (float(np.median(step)) if step.size else float('nan') for step in known)
    return down, right


def _limit(points: Floats, axis: int, reach: float | None) -> float:
    usual = _STRETCH * float(np.nan_to_num(spacings(points)[axis]))
    return usual if reach is None else min(usual, reach)


def links(grid: RangeGrid, axis: int, reach: float | None) -> Bools:
    """Tell of every point whether the next along ``axis`` is on the same surface."""
    points, limit = grid.points_xyz, _limit(grid.points_xyz, axis, reach)
    step = np.roll(points, -1, axis=axis) - points
    with np.errstate(invalid='ignore'):
        length = np.linalg.norm(step, axis=2)
        linked = (length < limit) & (
            np.abs((step * grid.sight).sum(axis=2)) <= _ALONG_SIGHT * length
        )
    if axis == 0:
        linked[-1] = False
    elif not grid.closed:
        linked[:, -1] = False
    return np.asarray(linked)


def _normals(grid: RangeGrid, down: Bools, right: Bools) -> Floats:
    """Return (rows, columns, 3) unit normals towards the eye; NaN where unknown."""
    points = grid.points_xyz
    steps = spacings(points)
    ratio = steps[1] / steps[0] if np.isfinite(steps).all() else 1.0
    # equal lengths both ways, so that both tangents are equally well known
    rows, columns = (max(1, min(8, round(r))) for r in (ratio, 1.0 / ratio))
    normals = np.cross(_tangent(points, down, 0, rows), _tangent(points, right, 1, columns))
    normals *= np.copysign(1.0, (normals * grid.sight).sum(axis=2, keepdims=True))
    with np.errstate(invalid='ignore', divide='ignore'):
        normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    return np.asarray(normals)


def _tangent(points: Floats, links: Bools, axis: int, most: int) -> Floats:
    """Return the step from the farthest linked point behind to the farthest ahead."""
    ahead, behind = points, points
    linked_ahead = np.ones(links.shape, dtype=bool)
    linked_behind = linked_ahead.copy()
    for step in range(1, most + 1):
        linked_ahead = linked_ahead & np.roll(links, -(step - 1), axis=axis)
        linked_behind = linked_behind & np.roll(links, step, axis=axis)
        ahead = np.where(linked_ahead[..., None], np.roll(points, -step, axis=axis), ahead)
        behind = np.where(linked_behind[..., None], np.roll(points, step, axis=axis), behind)
    return np.asarray(ahead - behind)


def _weights(grid: RangeGrid, normals: Floats) -> Floats:
    """
    Return 1/sigma^2 along the normal, less where the surface is seen obliquely.

    A stripe on a surface that turns away from the eye is wide and bends over its edges.
    """
    facing = np.clip((normals * grid.sight).sum(axis=2), 0.0, 1.0)
    error = grid.sight if grid.error is None else grid.error
    across = np.maximum(np.abs((normals * error).sum(axis=2)), _LEAST_ACROSS)
    with np.errstate(invalid='ignore', divide='ignore'):
        return np.asarray((0.05 + facing) / (grid.sigma * across) ** 2)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Ends:
    """Neighbours in a row: (n,) row, both columns, the step, into how many pieces it is cut."""

    row: Ints
    column: Ints
    following: Ints
    step: Floats
    pieces: Ints

    @classmethod
    def of(cls, grid: RangeGrid, linked: Bools, voxel: float) -> '_Ends':
        row, column = np.nonzero(linked)
        following = (column + 1) % linked.shape[1]
        step = grid.points_xyz[row, following] - grid.points_xyz[row, column]
        pieces = np.ceil(np.linalg.norm(step, axis=1) / voxel).astype(np.int64)
        return cls(
            row=row,
            column=column,
            following=following,
            step=step,
            pieces=np.clip(pieces, 1, _MOST_BETWEEN),
        )

    def cut_into(self, count: int) -> '_Ends':
        chosen = self.pieces == count
        return _Ends(**{field.name: getattr(self, field.name)[chosen] for field in fields(self)})


def _between(grid: RangeGrid, normals: Floats, weight: Floats, ends: _Ends) -> Iterator[Samples]:
    """Give samples between columns that are farther apart than a voxel."""
    for count in np.unique(ends.pieces[ends.pieces > 1]).tolist():
        chosen = ends.cut_into(count)
        for k in range(1, count):
            yield _on_curve(grid, normals, weight, chosen, k / count)


def _on_curve(
    grid: RangeGrid, normals: Floats, weight: Floats, ends: _Ends, part: float
) -> Samples:
    """Return samples at ``part`` of the way from one column to the next, on a smooth curve."""
    here, there = (ends.row, ends.column), (ends.row, ends.following)
    first, second = normals[here], normals[there]
    normal = (1.0 - part) * first + part * second
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    smooth = (first * second).sum(axis=1) > _SMOOTH
    # the parabola that has these normals at its ends
    bulge = 0.5 * part * (1.0 - part) * (ends.step * (second - first)).sum(axis=1) * smooth
    return Samples(
        points_xyz=grid.points_xyz[here] + part * ends.step + bulge[:, None] * normal,
        normals=normal,
        sight=np.broadcast_to(grid.sight, normals.shape)[here],
        weight=weight[here],
        intensity=(1.0 - part) * grid.intensity[here] + part * grid.intensity[there],
    )
