# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One move of the table by ``joint_trajectory``, checked by ``joint_states``."""

import math

from ivfmc_ros.errors import HelperError
from ivfmc_ros.nodes.scanning.cell_link import CellLink
from ivfmc_ros.scan.motion_check import MotionCheck
from ivfmc_ros.scan.plan import MotionLimits
from ivfmc_ros.scan.table_reports import JointReport

# Fraction of the tolerance within which a standing table needs no move.
_NO_MOVE = 0.1
# Seconds without a motion after which a command is repeated; MotionCheck waits 2 s for its begin.
_AGAIN_S = 0.6


class TableMotion:
    """
    A move to ``position`` (radians) at ``velocity`` (rad/s).

    is_needed : whether the table does not stand there
    seconds : planned duration
    """

    def __init__(
        self,
        link: CellLink,
        limits: MotionLimits,
        tolerance: float,
        position: float,
        velocity: float,
    ) -> None:
        start = link.position or 0.0
        self.is_needed = not link.table.stands_at(position, _NO_MOVE * tolerance)
        self.seconds = limits.seconds(position - start, velocity)
        self._link, self._position = link, position
        self._last: JointReport | None = None
        self._repeats = 0
        self._check = MotionCheck(
            start=start, target=position, velocity=velocity, tolerance=tolerance
        )

    def command(self) -> None:
        """Command the move."""
        self._link.command(self._position, self.seconds)

    def has_arrived(self) -> bool:
        """
        Return whether the table stands at the target, by what it reported since the command.

        :raises HelperError: it does not move as commanded
        """
        if self._link.table.stands_at(self._position, self._check.reach):
            return True
        report = self._link.table.last
        if report is None or report is self._last:
            return False
        self._last = report
        self._command_again()
        fault = self._check.update(report.position)
        if fault:
            self._link.hold(None)
            cause = self._link.diagnostics.controller_message
            raise HelperError(
                'MOTION_FAILED',
                f'{fault}, commanded to {math.degrees(self._position):.2f} degrees'
                + (f'; turntable: {cause}' if cause else ''),
            )
        return False

    def _command_again(self) -> None:
        """Send the command again where the middleware may have lost it."""
        due_s = (self._repeats + 1) * _AGAIN_S
        if self._check.waited_s > due_s and self._link.may_lose_commands():
            self._repeats += 1
            self._link.command(self._position, self.seconds)
