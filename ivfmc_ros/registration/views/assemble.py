# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Assembly of the profiles of a sweep into an organized point cloud (a view), and its geometry."""

from collections import defaultdict
from collections.abc import Iterable
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Bytes
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Profile
from ivfmc_ros.model import View

# A full turn may end with a gap of so many angle steps (lost steps of the table), and may overlap
# its beginning by so many.
_MAX_GAP_STEPS, _MAX_OVERLAP_STEPS = 4.0, 1.5
# A longer sweep, radians, was not meant to close only: half a turn is the greatest closure.
_MAX_CLOSING_SPAN = 3.2 * np.pi
# Neighboring profiles farther apart than this many median steps have profiles missing between.
_MISSING_STEPS = 3.5
# Points closer than this, meters, are duplicates.
_DUPLICATE_DISTANCE = 1e-9


def assemble(cell: Cell, profiles: Iterable[Profile]) -> list[View]:
    """
    Assemble profiles into views, one for each view number, ascending.

    Rows are image lines of the laser's stripe, columns are profiles by ascending angle.

    :raises GeometryError: a view number holds profiles of two lasers
    """
    sweeps: dict[int, list[Profile]] = defaultdict(list)
    for profile in profiles:
        sweeps[profile.view].append(profile)
    return [_assemble_one(cell, number, sweeps[number]) for number in sorted(sweeps)]


def _assemble_one(cell: Cell, number: int, profiles: Sequence[Profile]) -> View:
    lasers = {profile.laser for profile in profiles}
    if len(lasers) > 1:
        raise GeometryError(
            f'view {number}: has profiles of lasers {sorted(lasers)}; a view must be of one laser'
        )
    profiles = sorted(profiles, key=lambda profile: profile.angle)
    laser = cell.lasers[profiles[0].laser]
    by_row = laser.stripe == 'rows'
    shape = (cell.camera.height if by_row else cell.camera.width, len(profiles))
    column = np.repeat(np.arange(len(profiles)), [len(profile) for profile in profiles])
    uv = np.concatenate([profile.uv for profile in profiles])
    row = np.round(uv[:, 1 if by_row else 0]).astype(np.int64)

    def grid(name: str, *depth: int) -> Floats:
        values = np.full((*shape, *depth), np.nan)
        values[row, column] = np.concatenate([getattr(profile, name) for profile in profiles])
        return values

    return View(
        number=number,
        laser=profiles[0].laser,
        points_xyz=grid('points_xyz', 3),
        intensity=grid('intensity'),
        sigma=grid('sigma'),
        uv=grid('uv', 2),
        angles=np.array([profile.angle for profile in profiles]),
        seqs=np.array([profile.seq for profile in profiles], dtype=np.int64),
        color=_colors(profiles, shape, row, column),
    )


def _colors(
    profiles: Sequence[Profile], shape: tuple[int, int], row: Ints, column: Ints
) -> Bytes | None:
    """Return the colors of a view's points; None if a profile has no color."""
    known = [profile.color for profile in profiles if profile.color is not None]
    if len(known) < len(profiles):
        return None
    color = np.zeros((*shape, 3), dtype=np.uint8)
    color[row, column] = np.concatenate(known)
    return color


def is_full_turn(view: View) -> bool:
    """
    Return whether the sweep is a full turn, so that the last column is adjacent to the first.

    A table that loses steps leaves a gap; whether surface is built across it is decided by edge
    lengths.
    """
    if len(view.angles) < 3:
        return False
    steps = np.diff(view.angles)
    gap = 2.0 * np.pi - (view.angles[-1] - view.angles[0])
    step = np.median(steps)
    return bool(-_MAX_OVERLAP_STEPS * step <= gap <= _MAX_GAP_STEPS * step)


def within_one_turn(view: View) -> View:
    """
    Return the view without the profiles that lie a whole turn or more after its first one.

    A sweep that goes on beyond the turn repeats its beginning. The registration compares both; the
    surface needs one of them, and that one closes to a full turn. A sweep of about two turns is
    returned as it is: all of it was measured twice.
    """
    if len(view.angles) < 3 or np.ptp(view.angles) > _MAX_CLOSING_SPAN:
        return view
    step = float(np.median(np.diff(view.angles)))
    kept = view.angles < view.angles[0] + 2.0 * np.pi - 0.5 * step
    return view if kept.all() else select_columns(view, kept)


def select_columns(view: View, chosen: Bools) -> View:
    """Return the profiles of a view where (columns,) bool ``chosen`` is true."""
    return replace(
        view,
        points_xyz=view.points_xyz[:, chosen],
        intensity=view.intensity[:, chosen],
        sigma=view.sigma[:, chosen],
        uv=view.uv[:, chosen],
        angles=view.angles[chosen],
        seqs=view.seqs[chosen],
        color=None if view.color is None else view.color[:, chosen],
    )


def angle_runs(view: View) -> list[tuple[float, float]]:
    """Return the ranges of table angles, radians, in which no profiles are missing."""
    steps = np.diff(view.angles)
    if not steps.size:
        return [(float(view.angles[0]), float(view.angles[-1]))]
    last = np.flatnonzero(steps > _MISSING_STEPS * np.median(steps))
    begins = np.concatenate([[0], last + 1])
    ends = np.concatenate([last, [len(view.angles) - 1]])
    return [
        (float(view.angles[begin]), float(view.angles[end]))
        for begin, end in zip(begins, ends, strict=True)
    ]


def spacing(view: View) -> float:
    """
    Return the median distance of adjacent points of a view, meters; NaN if there are none.

    The larger one of the medians along profiles and across them. Duplicate points are ignored.
    """
    points = view.points_xyz
    along = np.linalg.norm(np.diff(points, axis=0), axis=2)
    across = np.linalg.norm(np.diff(points, axis=1), axis=2)
    known = [
        steps[np.isfinite(steps) & (steps > _DUPLICATE_DISTANCE)] for steps in (along, across)
    ]
    return max((float(np.median(steps)) for steps in known if steps.size), default=float('nan'))


def grid_normals(view: View) -> Floats:
    """
    Return the normal of every point that has neighbors on both axes of the grid.

    Neighbors are taken from the grid: a search by distance would find points of one profile only
    where profiles are farther apart than these. The sense of a normal is arbitrary.

    returns : (rows, columns, 3) float64, unit; NaN where it is unknown
    """
    points = view.points_xyz
    if is_full_turn(view):
        points = np.concatenate([points[:, -1:], points, points[:, :1]], axis=1)
    down, right = np.full_like(points, np.nan), np.full_like(points, np.nan)
    down[1:-1] = points[2:] - points[:-2]
    right[:, 1:-1] = points[:, 2:] - points[:, :-2]
    across = np.cross(down, right)
    if is_full_turn(view):
        across = across[:, 1:-1]
    with np.errstate(invalid='ignore'):
        return np.asarray(across / np.linalg.norm(across, axis=2, keepdims=True))


def viewing_vectors(cell: Cell, view: View) -> Floats:
    """Return (n, 3) meters in ``turntable``, vectors from the valid points to the camera."""
    eye = cell.turntable.to_part(np.zeros((1, 3)), 0.0)
    eyes = np.concatenate([eye @ R.T for R in transforms.rotation_z(-view.angles)])
    return np.asarray((eyes[None] - view.points_xyz)[view.valid])


def without(view: View, removed: Bools) -> View:
    """Return the view with the points of a (rows, columns) bool mask set to NaN."""
    gone = removed[..., None]
    return replace(
        view,
        points_xyz=np.where(gone, np.nan, view.points_xyz),
        intensity=np.where(removed, np.nan, view.intensity),
        sigma=np.where(removed, np.nan, view.sigma),
        uv=np.where(gone, np.nan, view.uv),
    )


def flying_points(view: View, max_distance: float, min_points: int) -> Bools:
    """
    Find flying points: connected components of fewer than ``min_points`` points.

    Points are connected if they are adjacent in the grid and not farther than ``max_distance``
    meters apart.

    returns : (rows, columns) bool, true for the points to remove
    """
    rows, columns = view.valid.shape
    index = np.arange(rows * columns).reshape(rows, columns)
    points = view.points_xyz
    edges = [
        _connected(points[:-1], points[1:], index[:-1], index[1:], max_distance),
        _connected(points[:, :-1], points[:, 1:], index[:, :-1], index[:, 1:], max_distance),
        _connected(points[:-1, :-1], points[1:, 1:], index[:-1, :-1], index[1:, 1:], max_distance),
        _connected(points[1:, :-1], points[:-1, 1:], index[1:, :-1], index[:-1, 1:], max_distance),
    ]
    if is_full_turn(view):
        edges.append(
            _connected(points[:, -1], points[:, 0], index[:, -1], index[:, 0], max_distance)
        )
    first, second = np.concatenate(edges, axis=1)
    ones = np.ones(len(first), dtype=bool)
    graph = coo_array((ones, (first, second)), shape=(index.size, index.size))
    _, component = connected_components(graph, directed=False)
    small = np.bincount(component)[component] < min_points
    return np.asarray(view.valid & small.reshape(rows, columns))


def _connected(a: Floats, b: Floats, index_a: Ints, index_b: Ints, max_distance: float) -> Ints:
    """Return (2, m) indices of the adjacent points that are connected."""
    with np.errstate(invalid='ignore'):
        connected = ((a - b) ** 2).sum(axis=-1) <= max_distance * max_distance
    return np.stack([index_a[connected], index_b[connected]])
