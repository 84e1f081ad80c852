# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the table reported: where it is, where it stands, and since when."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
import math

# The table is at standstill when this many joint states in a row say so ...
_STANDSTILL_REPORTS = 4
# ... with a velocity below this, rad/s: the noise of differentiated positions.
_STANDSTILL_VELOCITY = 5e-3
# Joint states that are kept: 0.5 s at 100 Hz.
_KEPT = 50
# A velocity that is not reported is the mean over this time, nanoseconds: from one report to the
# next, a single count of a 17-bit encoder at 200 Hz is 0.01 rad/s, more than a standing table's.
_VELOCITY_NS = 50_000_000
# Radians, below any step of a scan and above the noise of an encoder.
_SAME_ANGLE = 1e-3


@dataclass(frozen=True, kw_only=True)
class JointReport:
    """Position (radians, unwrapped) and velocity (rad/s) of the table at a stamp."""

    stamp_ns: int
    position: float
    velocity: float


@dataclass(frozen=True, kw_only=True)
class Standstill:
    """
    Where the table stands, and since when; stamps in nanoseconds.

    position : radians
    first_ns : of the first known report of it
    after_ns : of the last report of something else. The reports between both may be lost, or were
        too many to be kept by a node that was late, and what the table did meanwhile be done
    """

    position: float = 0.0
    first_ns: int = 0
    after_ns: int = 0

    def shows(self, angle: float, stamp_ns: int) -> bool:
        """
        Return whether a profile was taken at this standstill.

        angle : radians, without whole turns
        """
        off = math.remainder(angle - self.position, 2.0 * math.pi)
        return stamp_ns >= self.first_ns or (stamp_ns > self.after_ns and abs(off) < _SAME_ANGLE)


def _mean_velocity(reports: Sequence[JointReport], stamp_ns: int, position: float) -> float:
    """
    Return the velocity of a joint that does not report it, rad/s; infinite without a report.

    reports : the former ones, ascending
    stamp_ns, position : of the new one, nanoseconds and radians
    """
    if not reports:
        return math.inf
    old = (report for report in reversed(reports) if stamp_ns - report.stamp_ns >= _VELOCITY_NS)
    since = next(old, reports[0])
    seconds = (stamp_ns - since.stamp_ns) * 1e-9
    return (position - since.position) / seconds if seconds > 0.0 else reports[-1].velocity


class TableReports:
    """The last joint states of the table, in the order of their arrival."""

    def __init__(self) -> None:
        self._reports: deque[JointReport] = deque(maxlen=_KEPT)
        self._since_command = 0
        # stamp of the last joint state in motion, or before the last command
        self._moved_ns = 0

    @property
    def last(self) -> JointReport | None:
        """The last joint state; None before the first one."""
        return self._reports[-1] if self._reports else None

    def add(self, stamp_ns: int, position: float, velocity: float | None) -> None:
        """
        Add a joint state.

        stamp_ns, position : nanoseconds and radians, unwrapped
        velocity : rad/s; None where the driver reports none: it is taken from the positions
        """
        moving_ns = stamp_ns
        if velocity is None:
            velocity = _mean_velocity(self._reports, stamp_ns, position)
            # of the time before: after a gap of the reports the table may stand here for long
            moving_ns = self._elsewhere_ns(position)
        self._reports.append(JointReport(stamp_ns=stamp_ns, position=position, velocity=velocity))
        self._since_command += 1
        if abs(velocity) > _STANDSTILL_VELOCITY:
            self._moved_ns = moving_ns

    def begin_move(self) -> None:
        """Forget the standstill until now: the table was commanded to move."""
        self._since_command = 0
        if self._reports:
            self._moved_ns = self._reports[-1].stamp_ns

    def stands_at(self, position: float, tolerance: float) -> bool:
        """
        Return whether the last joint states agree on standstill at ``position``, radians.

        Those from before the last command do not count.
        """
        last = list(self._reports)[-_STANDSTILL_REPORTS:]
        enough = min(len(last), self._since_command) >= _STANDSTILL_REPORTS
        return enough and all(
            abs(report.position - position) <= tolerance
            and abs(report.velocity) <= _STANDSTILL_VELOCITY
            for report in last
        )

    @property
    def standstill(self) -> Standstill:
        """
        Where the table stands since its last move.

        It begins with the first joint state that says so, not with the last few: this node may be
        late, and the profile of this position be there.
        """
        first_ns = 0
        for number, report in enumerate(reversed(self._reports)):
            is_old = number >= max(self._since_command, _STANDSTILL_REPORTS)
            if is_old or abs(report.velocity) > _STANDSTILL_VELOCITY:
                break
            first_ns = report.stamp_ns
        return Standstill(
            position=self._reports[-1].position if self._reports else 0.0,
            first_ns=first_ns,
            after_ns=self._moved_ns,
        )

    def _elsewhere_ns(self, position: float) -> int:
        """Return the stamp of the last report of another position, nanoseconds."""
        elsewhere = (
            report.stamp_ns
            for report in reversed(self._reports)
            if abs(report.position - position) > _SAME_ANGLE
        )
        return next(elsewhere, self._moved_ns)
