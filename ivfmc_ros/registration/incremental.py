# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Views placed one by one as they come, while the table still turns; all at once comes later."""

from dataclasses import dataclass
from dataclasses import field

import numpy as np

from ivfmc_ros.model import Floats
from ivfmc_ros.model import View
from ivfmc_ros.registration.patches import fit_patches
from ivfmc_ros.registration.patches import joined
from ivfmc_ros.registration.patches import Patches
from ivfmc_ros.registration.prior import TablePrior
from ivfmc_ros.registration.samples import common_edge
from ivfmc_ros.registration.samples import sample
from ivfmc_ros.registration.table import place_on
from ivfmc_ros.registration.verdict import Verdict

# So few samples of a view are enough for a first placing.
_MOST = 3000


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
        patches = fit_patches(sample(view, step), step)
        last = next(reversed(self.poses.values()), np.eye(4))
        T, verdict = np.eye(4), Verdict(view=view.number, applied=False, why='reference')
        if any(len(known) for known in self._known):
            found, verdict = place_on(
                joined(self._known), patches.posed(last), step, view.number, self.prior, self.reach
            )
            T = found @ last
        self._known.append(patches.posed(T))
        self.poses[view.number] = T
        self.verdicts[view.number] = verdict
        return verdict
