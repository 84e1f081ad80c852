# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The samples of all views, without what the ends of stripes tell wrongly."""

from collections.abc import Iterator
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.meshing.samples.orphan_points import adopted
from ivfmc_ros.meshing.samples.ray_projection import settled
from ivfmc_ros.meshing.samples.ray_projection import Stripes
from ivfmc_ros.meshing.samples.surface_samples import from_grid
from ivfmc_ros.meshing.samples.surface_samples import merge
from ivfmc_ros.meshing.samples.surface_samples import range_grid
from ivfmc_ros.meshing.samples.surface_samples import Samples
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Poses
from ivfmc_ros.model import View

# Profiles nearer than this (radians; share of a usual step) are one place of several turns.
_SAME_ANGLE, _SAME_STEP = 1e-6, 0.2
# How far the face of a point without a normal may be, if nothing else is said.
_REACH = 6.0  # voxels


def from_views(
    cell: Cell, views: Sequence[View], poses: Poses, reach: float | None, voxel: float
) -> Samples:
    """
    Return the samples of all views.

    reach : metres, the longest step between neighbours; None for what the spacing allows
    voxel : metres; between columns farther apart than this, samples are interpolated
    """
    known = np.concatenate([view.sigma[np.isfinite(view.sigma)] for view in views])
    sigma = float(np.median(known)) if known.size else 0.0
    stripes = [
        Stripes.of(range_grid(cell, turn, T), reach, sigma)
        for view, T in zip(views, poses.turntable_from_view, strict=True)
        for turn in turns_of(view)
    ]
    grids, left_out = settled(stripes, sigma, voxel)
    samples = merge(from_grid(grid, reach, voxel) for grid in grids)
    return adopted(samples, left_out, sigma, voxel, reach or _REACH * voxel)


def turns_of(view: View) -> Iterator[View]:
    """Give each turn of a view in which the table passed the same angles several times."""
    steps = np.diff(view.angles)
    real = steps[steps > _SAME_ANGLE]
    if not len(real):
        yield view
        return
    place = np.concatenate([[0], np.cumsum(steps > _SAME_STEP * np.median(real))])
    starts = np.searchsorted(place, place)
    turn = np.arange(len(place)) - starts
    for number in range(int(turn.max()) + 1):
        yield _columns(view, turn == number)


def _columns(view: View, chosen: Bools) -> View:
    return replace(
        view,
        points_xyz=view.points_xyz[:, chosen],
        intensity=view.intensity[:, chosen],
        sigma=view.sigma[:, chosen],
        uv=view.uv[:, chosen],
        angles=view.angles[chosen],
        seqs=view.seqs[chosen],
    )
