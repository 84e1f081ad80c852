# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Views placed one by one as they come, while the table still turns; all at once comes later."""

from dataclasses import dataclass
from dataclasses import field
from dataclasses import replace

import numpy as np

from ivfmc_ros.model import Floats
from ivfmc_ros.model import View
from ivfmc_ros.registration.solver.downsample import common_edge
from ivfmc_ros.registration.solver.downsample import sample
from ivfmc_ros.registration.solver.prior import TablePrior
from ivfmc_ros.registration.solver.surfels import fit_patches
from ivfmc_ros.registration.solver.surfels import joined
from ivfmc_ros.registration.solver.surfels import Patches
from ivfmc_ros.registration.solver.verdict import Verdict
from ivfmc_ros.registration.table import place_on

# So few samples of a view are enough for a first placing, each the mean of so many rows at most.
_MOST, _ROWS = 700, 3
# How far rows are apart is seen in each so many-th profile.
_FEW = 5


@dataclass(kw_only=True)
class Incremental:
    """
    The views of a scan so far.

    Each is placed on those before it, with the table as a prior; the first defines the frame. A
    part that was moved is taken to stay where it is: a view is looked for where the one before
    it was found.

    prior : how far the table may err between two views
    reach : metres, points farther apart are no partners
    """

    prior: TablePrior = field(default_factory=TablePrior)
    reach: float = 1.5e-3
    poses: dict[int, Floats] = field(default_factory=dict)
    verdicts: dict[int, Verdict] = field(default_factory=dict)
    _known: list[Patches] = field(default_factory=list)
    _edge: float = float('nan')

    def add(self, view: View) -> Verdict:
        """
        Place a view.

        :raises GeometryError: it has points that no table carries
        """
        if not np.isfinite(self._edge):
            self._edge = common_edge([view], _MOST)
        step = self._edge if np.isfinite(self._edge) else 1.0
        patches = fit_patches(sample(_thinned(view, step), step), step)
        last = next(reversed(self.poses.values()), np.eye(4))
        T, verdict = np.eye(4), Verdict(view=view.number, applied=False, why='reference')
        if any(len(known) for known in self._known):
            here = patches.posed(last)
            found, verdict = place_on(
                self._around(here), here, step, view.number, self.prior, self.reach
            )
            T = found @ last
        self._known.append(patches.posed(T))
        self.poses[view.number] = T
        self.verdicts[view.number] = verdict
        return verdict

    def _around(self, patches: Patches) -> Patches:
        """Return the surface known so far that patches may meet."""
        known = joined(self._known)
        margin = self.reach + 2.0 * self._edge
        low = patches.points_xyz.min(axis=0, initial=np.inf) - margin
        high = patches.points_xyz.max(axis=0, initial=-np.inf) + margin
        inside = ((known.points_xyz > low) & (known.points_xyz < high)).all(axis=1)
        return known.chosen(inside)


def _thinned(view: View, edge: float) -> View:
    """Return some rows of a view: a camera has many more of them than a placing needs."""
    down = np.linalg.norm(np.diff(view.points_xyz[:, ::_FEW], axis=0), axis=2)
    known = down[np.isfinite(down)]
    every = int(edge / _ROWS / np.median(known)) if known.size and np.median(known) > 0 else 1
    some = slice(None, None, max(every, 1))
    arrays = ('points_xyz', 'intensity', 'sigma', 'uv')
    color = None if view.color is None else view.color[some]
    return replace(view, **{name: getattr(view, name)[some] for name in arrays}, color=color)
