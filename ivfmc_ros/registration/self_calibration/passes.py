# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The passes of a sweep: a top face crosses the sheet twice a turn, before and beyond the axis.

Both passes see the same surface, at table angles half a turn apart, so that an axis that leans
shows it twice. To the grid of the view they are neighbours in nothing, and their mean would be a
surface that nobody saw.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.model import Bools
from ivfmc_ros.model import View
from ivfmc_ros.registration.self_calibration.jacobians import crossing_rate
from ivfmc_ros.registration.self_calibration.jacobians import Measured
from ivfmc_ros.registration.self_calibration.jacobians import turned_back
from ivfmc_ros.registration.views.assemble import without

# Fewer points than this are no pass.
_LEAST_POINTS = 100


@dataclass(frozen=True, eq=False, kw_only=True)
class Pass:
    """
    Points of one view that crossed the sheet in one sense.

    owner : index of the view; points : (n,) bool, which of the view's valid points
    """

    owner: int
    points: Bools

    def of(self, view: View) -> View:
        """Return the view with the points of this pass only."""
        removed = view.valid
        removed[removed] = ~self.points
        return without(view, removed)


def passes_of(cell: Cell, found: Sequence[Measured]) -> list[Pass]:
    """Return the passes of every view; a view without points has one, which is empty."""
    passes = []
    for owner, one in enumerate(found):
        laser = cell.lasers[one.view.laser]
        base = turned_back(one.view.cloud(), -one.angles)
        rising = crossing_rate(cell, laser, base) > 0
        sides = [side for side in (rising, ~rising) if side.sum() >= _LEAST_POINTS]
        passes += [Pass(owner=owner, points=side) for side in sides or [rising | ~rising]]
    return passes
