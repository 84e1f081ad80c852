# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Profiles of one sweep, put side by side as an organised cloud."""

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

# A seam of so many steps is still neighbours.
_SEAM_STEPS = 4.0
# Points nearer than this (metres) are one point that is there twice.
_SAME_PLACE = 1e-9


def assemble(cell: Cell, profiles: Iterable[Profile]) -> list[View]:
    """
    Sort profiles into views, one for each view number, ascending.

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
            f'view {number}: has profiles of lasers {sorted(lasers)}; a view is one'
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
        color=_colours(profiles, shape, row, column),
    )


def _colours(
    profiles: Sequence[Profile], shape: tuple[int, int], row: Ints, column: Ints
) -> Bytes | None:
    """Return the colours of a view's points; None where any profile has none."""
    known = [profile.color for profile in profiles if profile.color is not None]
    if len(known) < len(profiles):
        return None
    color = np.zeros((*shape, 3), dtype=np.uint8)
    color[row, column] = np.concatenate(known)
    return color


def closes(view: View) -> bool:
    """
    Tell whether the sweep is a full turn, so that its last column neighbours its first.

    A table that loses steps ends a little before the turn is full; what the gap may span is
    decided by the length of the edges across it.
    """
    if len(view.angles) < 3:
        return False
    steps = np.diff(view.angles)
    gap = 2.0 * np.pi - (view.angles[-1] - view.angles[0])
    return bool(-1.5 * np.median(steps) <= gap <= _SEAM_STEPS * np.median(steps))


def spacing(view: View) -> float:
    """
    Return the median distance of neighbouring points of a view, metres; NaN if none.

    Points that are there several times count as one.
    """
    points = view.points_xyz
    along = np.linalg.norm(np.diff(points, axis=0), axis=2)
    across = np.linalg.norm(np.diff(points, axis=1), axis=2)
    known = [steps[np.isfinite(steps) & (steps > _SAME_PLACE)] for steps in (along, across)]
    return max((float(np.median(steps)) for steps in known if steps.size), default=float('nan'))


def grid_normals(view: View) -> Floats:
    """
    Return the normal of every point that has neighbours on both axes of the grid.

    The grid knows which points are neighbours on the surface; a search by distance does not when
    profiles lie farther apart than the points of one profile. The sense of a normal is arbitrary.

    returns : (rows, columns, 3) float64, unit; NaN where it is unknown
    """
    points = view.points_xyz
    if closes(view):
        points = np.concatenate([points[:, -1:], points, points[:, :1]], axis=1)
    down, right = np.full_like(points, np.nan), np.full_like(points, np.nan)
    down[1:-1] = points[2:] - points[:-2]
    right[:, 1:-1] = points[:, 2:] - points[:, :-2]
    across = np.cross(down, right)
    if closes(view):
        across = across[:, 1:-1]
    with np.errstate(invalid='ignore'):
        return np.asarray(across / np.linalg.norm(across, axis=2, keepdims=True))


def sight_of(cell: Cell, view: View) -> Floats:
    """Return (n, 3) metres in ``turntable`` from the view's valid points to the camera."""
    eye = cell.turntable.to_part(np.zeros((1, 3)), 0.0)
    eyes = np.concatenate([eye @ R.T for R in transforms.rotation_z(-view.angles)])
    return np.asarray((eyes[None] - view.points_xyz)[view.valid])


def without(view: View, removed: Bools) -> View:
    """Return the view with the points of a (rows, columns) mask made NaN."""
    gone = removed[..., None]
    return replace(
        view,
        points_xyz=np.where(gone, np.nan, view.points_xyz),
        intensity=np.where(removed, np.nan, view.intensity),
        sigma=np.where(removed, np.nan, view.sigma),
        uv=np.where(gone, np.nan, view.uv),
    )


def islands(view: View, reach: float, least: int) -> Bools:
    """
    Find flying points: pieces of fewer than ``least`` points that hang together.

    Neighbours are the next valid rows and columns of the grid, no farther than ``reach`` metres.

    returns : (rows, columns) bool, true for the points to remove
    """
    rows, columns = view.valid.shape
    index = np.arange(rows * columns).reshape(rows, columns)
    points = view.points_xyz
    pairs = [
        _near(points[:-1], points[1:], index[:-1], index[1:], reach),
        _near(points[:, :-1], points[:, 1:], index[:, :-1], index[:, 1:], reach),
        _near(points[:-1, :-1], points[1:, 1:], index[:-1, :-1], index[1:, 1:], reach),
        _near(points[1:, :-1], points[:-1, 1:], index[1:, :-1], index[:-1, 1:], reach),
    ]
    if closes(view):
        pairs.append(_near(points[:, -1], points[:, 0], index[:, -1], index[:, 0], reach))
    first, second = np.concatenate(pairs, axis=1)
    ones = np.ones(len(first), dtype=bool)
    graph = coo_array((ones, (first, second)), shape=(index.size, index.size))
    _, piece = connected_components(graph, directed=False)
    small = np.bincount(piece)[piece] < least
    return np.asarray(view.valid & small.reshape(rows, columns))


def _near(a: Floats, b: Floats, index_a: Ints, index_b: Ints, reach: float) -> Ints:
    with np.errstate(invalid='ignore'):
        near = ((a - b) ** 2).sum(axis=-1) <= reach * reach
    return np.stack([index_a[near], index_b[near]])
