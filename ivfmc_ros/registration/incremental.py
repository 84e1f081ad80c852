# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Incremental registration: each view is aligned to those before it while the scan runs."""

from dataclasses import dataclass
from dataclasses import field
from dataclasses import replace

import numpy as np

from ivfmc_ros.model import Floats
from ivfmc_ros.model import View
from ivfmc_ros.registration.solver.downsample import common_voxel_size
from ivfmc_ros.registration.solver.downsample import downsample
from ivfmc_ros.registration.solver.prior import TablePrior
from ivfmc_ros.registration.solver.surfels import concatenate_surfels
from ivfmc_ros.registration.solver.surfels import fit_surfels
from ivfmc_ros.registration.solver.surfels import Surfels
from ivfmc_ros.registration.solver.verdict import Verdict
from ivfmc_ros.registration.table import register_view

# Samples of a view, and rows of the camera that are averaged in each: enough for a provisional
# pose within milliseconds (bench row 'a view placed').
_MAX_SAMPLES, _ROWS_PER_SAMPLE = 700, 3
# Every so many-th profile is used to measure the spacing of rows.
_PROFILE_STRIDE = 5


@dataclass(kw_only=True)
class IncrementalRegistration:
    """
    Poses of the views of a running scan.

    Each view is aligned to those before it, with the table as a prior; the first defines the
    frame. A part that has moved stays where it is, so that the initial pose of a view is that of
    the view before it. A joint registration of all views follows when the scan has ended.

    prior : standard deviations of the table's pose between two views
    max_correspondence_distance : meters
    poses : (4, 4) turntable_from_view, by the number of the view
    """

    prior: TablePrior = field(default_factory=TablePrior)
    max_correspondence_distance: float = 1.5e-3
    poses: dict[int, Floats] = field(default_factory=dict)
    verdicts: dict[int, Verdict] = field(default_factory=dict)
    _known: list[Surfels] = field(default_factory=list)
    _spacing: float = float('nan')

    def add(self, view: View) -> Verdict:
        """
        Register a view.

        :raises GeometryError: it has points farther than 100 m away, or partly finite points
        """
        if not np.isfinite(self._spacing):
            self._spacing = common_voxel_size([view], _MAX_SAMPLES)
        spacing = self._spacing if np.isfinite(self._spacing) else 1.0
        surfels = fit_surfels(downsample(_subsample_rows(view, spacing), spacing), spacing)
        last = next(reversed(self.poses.values()), np.eye(4))
        T, verdict = np.eye(4), Verdict(view=view.number, applied=False, why='reference')
        if any(len(known) for known in self._known):
            expected = surfels.transformed(last)
            correction, verdict = register_view(
                self._nearby(expected),
                expected,
                spacing,
                view.number,
                self.prior,
                self.max_correspondence_distance,
            )
            T = correction @ last
        self._known.append(surfels.transformed(T))
        self.poses[view.number] = T
        self.verdicts[view.number] = verdict
        return verdict

    def _nearby(self, surfels: Surfels) -> Surfels:
        """Return the known surfels in the bounding box of ``surfels``, with a margin."""
        known = concatenate_surfels(self._known)
        margin = self.max_correspondence_distance + 2.0 * self._spacing
        low = surfels.points_xyz.min(axis=0, initial=np.inf) - margin
        high = surfels.points_xyz.max(axis=0, initial=-np.inf) + margin
        inside = ((known.points_xyz > low) & (known.points_xyz < high)).all(axis=1)
        return known.select(inside)


def _subsample_rows(view: View, spacing: float) -> View:
    """Return a view with every n-th row: a camera has many more rows than samples need."""
    down = np.linalg.norm(np.diff(view.points_xyz[:, ::_PROFILE_STRIDE], axis=0), axis=2)
    known = down[np.isfinite(down)]
    measurable = known.size and np.median(known) > 0
    stride = int(spacing / _ROWS_PER_SAMPLE / np.median(known)) if measurable else 1
    rows = slice(None, None, max(stride, 1))
    arrays = ('points_xyz', 'intensity', 'sigma', 'uv')
    color = None if view.color is None else view.color[rows]
    return replace(view, **{name: getattr(view, name)[rows] for name in arrays}, color=color)
