# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Surface samples of all views, after correction of their uncertain points."""

from collections.abc import Iterator
from collections.abc import Sequence

import numpy as np

from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.meshing.parallel import map_chunked
from ivfmc_ros.meshing.samples.orphan_points import attach_orphan_points
from ivfmc_ros.meshing.samples.range_grid import make_range_grid
from ivfmc_ros.meshing.samples.ray_projection import ClassifiedGrid
from ivfmc_ros.meshing.samples.ray_projection import project_uncertain_points
from ivfmc_ros.meshing.samples.surface_samples import merge_samples
from ivfmc_ros.meshing.samples.surface_samples import sample_grid
from ivfmc_ros.meshing.samples.surface_samples import SurfaceSamples
from ivfmc_ros.model import Poses
from ivfmc_ros.model import View
from ivfmc_ros.registration.views.assemble import select_columns

# Profiles nearer than both (radians; share of the median step) are at one angle of several turns.
_SAME_ANGLE, _SAME_STEP = 1e-6, 0.2
# Default search radius for the face that an orphan point belongs to, voxels.
_ORPHAN_SEARCH_RADIUS = 6.0


def sample_views(
    cell: Cell, views: Sequence[View], poses: Poses, max_edge: float | None, voxel: float
) -> SurfaceSamples:
    """
    Return the surface samples of all views in ``turntable``.

    max_edge : meters, greatest distance of neighbors; None for 6 median spacings only
    voxel : meters; between columns farther apart than this, samples are interpolated
    """
    known = np.concatenate([view.sigma[np.isfinite(view.sigma)] for view in views])
    sigma = float(np.median(known)) if known.size else 0.0
    classified = [
        ClassifiedGrid.of(make_range_grid(cell, turn, T), max_edge, sigma)
        for view, T in zip(views, poses.turntable_from_view, strict=True)
        for turn in split_turns(view)
    ]
    grids, dropped = project_uncertain_points(classified, sigma, voxel)
    samples = merge_samples(
        map_chunked(lambda one: sample_grid(grids[one.start], max_edge, voxel), len(grids), 1)
    )
    radius = max_edge or _ORPHAN_SEARCH_RADIUS * voxel
    return attach_orphan_points(samples, dropped, sigma, voxel, radius)


def split_turns(view: View) -> Iterator[View]:
    """Yield one view for each turn of the table, if the same angles were passed several times."""
    steps = np.diff(view.angles)
    real = steps[steps > _SAME_ANGLE]
    if not len(real):
        yield view
        return
    position = np.concatenate([[0], np.cumsum(steps > _SAME_STEP * np.median(real))])
    starts = np.searchsorted(position, position)
    turn = np.arange(len(position)) - starts
    for number in range(int(turn.max()) + 1):
        yield select_columns(view, turn == number)
