# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Split of a view into its passes through the laser plane.

A top face crosses the plane twice a turn, in front of the axis and behind it. Both passes measure
the same surface at table angles half a turn apart, so that a tilted axis separates them. They are
not neighbors in the grid of the view, and averaging them would give a surface that does not exist.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.model import Bools
from ivfmc_ros.model import View
from ivfmc_ros.registration.self_calibration.jacobians import MeasuredView
from ivfmc_ros.registration.self_calibration.jacobians import plane_crossing_speed
from ivfmc_ros.registration.self_calibration.jacobians import table_from_base
from ivfmc_ros.registration.views.assemble import without

# A pass with fewer points is dropped.
_MIN_POINTS = 100


@dataclass(frozen=True, eq=False, kw_only=True)
class Pass:
    """
    Points of one view that crossed the laser plane in one direction.

    view_index : index of the view
    points : (n,) bool, which of the view's valid points
    """

    view_index: int
    points: Bools

    def extract(self, view: View) -> View:
        """Return the view with the points of this pass only."""
        removed = view.valid
        removed[removed] = ~self.points
        return without(view, removed)


def split_passes(cell: Cell, views: Sequence[MeasuredView]) -> list[Pass]:
    """Return the passes of every view; a view without points has one, which is empty."""
    passes = []
    for view_index, measured in enumerate(views):
        laser = cell.lasers[measured.view.laser]
        base = table_from_base(measured.view.cloud(), -measured.angles)
        rising = plane_crossing_speed(cell, laser, base) > 0
        sides = [side for side in (rising, ~rising) if side.sum() >= _MIN_POINTS]
        passes += [
            Pass(view_index=view_index, points=side) for side in sides or [rising | ~rising]
        ]
    return passes
