# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Compares what the nodes of the cell delivered for a scan with what its plan asked for."""

from collections.abc import Sequence

from ivfmc_ros.nodes.scanning.cell_link import CellLink
from ivfmc_ros.scan.completeness import Completeness
from ivfmc_ros.scan.job import Outcome
from ivfmc_ros.scan.plan import MotionLimits
from ivfmc_ros.scan.plan import Plan
from ivfmc_ros.scan.plan import Sweep
from ivfmc_ros.scan.resume import Course
from ivfmc_ros.scan.view_coverage import CompletenessLimits

_INCOMPLETE = 'INCOMPLETE'


class ScanChecks:
    """
    Completeness of one scan, by the headers of its profiles.

    notes : doubts about the scan that are said in its answer
    """

    def __init__(
        self,
        link: CellLink,
        plan: Plan,
        motion: MotionLimits,
        limits: CompletenessLimits,
        scan_id: str,
    ) -> None:
        self.notes: list[str] = []
        self._link = link
        self._scan_id = scan_id
        self._completeness = Completeness(plan, motion, limits)

    def take_over(self, course: Course) -> None:
        """Go on with a scan that was interrupted."""
        self._completeness.take_over(course.begun, course.parts)

    @property
    def executed(self) -> Sequence[Sweep]:
        """The sweeps that have begun."""
        return self._completeness.executed

    def begin(self, sweep: Sweep) -> None:
        """Note that a sweep is executed now."""
        self._completeness.begin(sweep)

    def remaining(self, sweep: Sweep) -> Sequence[Sweep]:
        """Return the sweeps that take what is missing of one that was interrupted."""
        return self._completeness.remaining(sweep, self._link.headers)

    def retakes(self, sweep: Sweep) -> Sequence[Sweep]:
        """Return the sweeps that take the missing angles of ``sweep`` again."""
        return self._completeness.retakes(sweep, self._link.headers)

    def judge(self, outcome: Outcome) -> None:
        """Add what came to the outcome, and the code INCOMPLETE where it is not what was asked."""
        headers = self._link.headers
        registered = outcome.registration.get('views', ())
        views = self._completeness.coverage(headers, registered)
        cut = self._link.diagnostics.part_cut(self._scan_id)
        outcome.completeness = {
            'part_cut': cut,
            'views': [view.as_dict() for view in views],
            'images': self._completeness.lost_images(headers, self._link.info_stamps_ns),
        }
        said = self._link.diagnostics
        doubts = (said.unsettled(self._scan_id), said.focus(self._scan_id))
        for note in (cut, *doubts, *self.notes):
            if note:
                outcome.mark('OK', note)
        incomplete = [view.why for view in views if view.why]
        if incomplete:
            outcome.mark(_INCOMPLETE, '; '.join(incomplete))
