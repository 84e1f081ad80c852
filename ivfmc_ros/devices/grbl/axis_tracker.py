# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Position of the axis of a GRBL controller, from commanded trajectories and status reports.

GRBL's reports have no checksum, so no single report moves the axis: a position that is not the
expected one counts when the next report agrees with it.
"""

import time

from ivfmc_ros.devices.grbl.index_mark import IndexMark
from ivfmc_ros.devices.grbl.protocol import StatusReport
from ivfmc_ros.devices.motion.axis_units import AxisUnits
from ivfmc_ros.devices.motion.position_estimator import PositionEstimator
from ivfmc_ros.devices.motion.trajectory import Trajectory

_EARLY_END = 0.5  # seconds by which a motion may end before its plan; clocks differ by 0.5 %
_END_DELAY = 0.3  # seconds after its planned end until a motion counts as ended without response
_POSITION_TOLERANCE = 0.05  # controller units from the target, eight steps of the bench table
# A report contradicts the commanded motion if the plan does not pass its position within so many
# seconds of query and report: clock error and start delay are below a third of it. So many
# in a row are no damaged line: the controller executes another motion than the one sent.
_MOTION_TIME_TOLERANCE = 0.3
_MAX_CONTRADICTIONS = 3
# On a busy computer the driver learns late that a motion has begun, and the whole motion seems
# early or late by one time. Two reports in a row that agree on it within this, seconds, shift the
# plan: once a motion, in its first seconds and by a limited time. A motion at another speed
# disagrees again; what is late later was held up on its way, and its positions were wrong.
_SHIFT_TOLERANCE, _MAX_SHIFT, _SHIFT_WITHIN = 0.05, 2.0, 1.5
_PENDANT_TIME = 0.5  # seconds between two reports of an axis that is moved by hand
_MM_PER_INCH = 25.4
_ROTARY = 'ABC'  # letters of axes that turn


class AxisTracker:
    """
    Follows the axis. Positions are unwrapped controller units, times are steady seconds.

    Not thread safe.

    lost : the axis is not where the commanded motion should have taken it; set until it is cleared
    positions : count of reports whose position was used
    reported, reported_ns : last position that was used, and when, nanoseconds since the epoch
    """

    def __init__(self, units: AxisUnits, index_pin: str = '') -> None:
        """``index_pin`` : letter of the input that is active once a turn, '' without one."""
        self._units = units
        self._index_pin, self._index_mark = index_pin, IndexMark(units.turn)
        self._estimator = PositionEstimator()
        self._announced: Trajectory | None = None  # sent, not accepted yet
        self._expected: float | None = None  # where the last motion should have ended
        # the axis may stand anywhere: its last motion was not commanded, or was interrupted
        self._standstill_unknown = True
        self._unconfirmed: float | None = None  # position that the next report must confirm
        self._contradictions = 0  # reports in a row that contradict the commanded motion
        self._lateness: float | None = None  # by the last one of these
        self._shifted = False  # whether the plan of the motion was shifted
        self._work_offset: float | None = None  # machine minus work position
        self._new_work_offset: float | None = None
        self._commanded_at = 0.0  # a report to an earlier query does not tell of an arrival
        self._held_at: float | None = None  # position of the last report of a hold
        self.held = False
        self.lost = False
        self.positions = 0
        self.reported, self.reported_ns = 0.0, 0

    @property
    def standing(self) -> bool:
        """Whether no motion is planned."""
        return self._estimator.standing

    @property
    def commanded(self) -> bool:
        """Whether a motion is planned, or was sent."""
        return self._announced is not None or not self._estimator.standing

    @property
    def index_text(self) -> str:
        """What the index mark told, '' without one."""
        return self._index_mark.text if self._index_pin else ''

    @property
    def target(self) -> float:
        """Where the axis stands, or the motion ends."""
        return self._estimator.target

    def state_at(self, now: float) -> tuple[float, float]:
        """Return the estimated (position, velocity)."""
        return self._estimator.state_at(now)

    # -- commands

    def begin_connection(self) -> None:
        """Forget what is known of the position."""
        self.forget_standstill()
        self._work_offset = self._new_work_offset = None

    def forget_standstill(self) -> None:
        """Accept whatever position is reported next, if two reports agree on it."""
        self._expected, self._standstill_unknown, self.lost = None, True, False
        self._index_mark.reset()

    def interrupt(self, now: float, *, keeps_position: bool = False) -> None:
        """
        Note that a motion, if there is one, was cut off: the axis stands.

        keeps_position : a reset keeps the position of a standing table, a power-on does not
        """
        known = keeps_position and self.standing and not self._standstill_unknown
        self._expected = self._estimator.target if known else None
        self._standstill_unknown = not known
        self._set_standstill(self._estimator.state_at(now)[0])

    def announce(self, plan: Trajectory) -> None:
        """Note a move that is about to be sent."""
        self._announced, self._expected, self._unconfirmed = plan, None, None
        self._contradictions = 0

    def withdraw(self) -> None:
        """Note that the announced move was not accepted; it may be executed all the same."""
        self._announced, self._standstill_unknown = None, True

    def begin(self, now: float) -> None:
        """Note that the announced move was accepted: it begins."""
        if self._announced is not None:
            self._estimator.begin(self._announced, now)
            self._lateness, self._shifted = None, False
            self._announced, self._commanded_at = None, now

    def end(self, now: float) -> bool:
        """
        Note that the drain command was answered: the motion has ended at its target.

        An answer that comes much too early is none: the reports tell when the motion ends.

        :returns: whether there was a motion, and it has ended
        """
        if self._estimator.standing or not self._estimator.has_ended(now + _EARLY_END):
            return False
        self._expected, self._standstill_unknown = self._estimator.target, False
        self._set_standstill(self._estimator.target)
        return True

    def brake(self, deceleration: float, now: float) -> None:
        """Note that a feed hold was sent; ``deceleration`` in units per s^2."""
        self._announced = None
        self._estimator.brake(deceleration, now)
        self._standstill_unknown, self.held, self._held_at = True, False, None

    # -- reports

    def update(
        self,
        report: StatusReport,
        times: tuple[float, float],
        *,
        waiting: bool,
        in_inches: bool | None,
        max_rate: float,
    ) -> bool:
        """
        Evaluate a report; return whether it has a position.

        times : of query and report
        waiting : a command waits for the standstill
        in_inches : whether the controller is set to inches ($13), None if that is not known yet
        max_rate : of the axis, units per second
        """
        controller_units = self._position(report, in_inches)
        if controller_units is None:
            return False
        expected = self._estimator.state_at(time.monotonic())[0]
        units = self._units.unwrap(controller_units, expected)
        if self._use(report, units, times, waiting, max_rate):
            self.reported, self.reported_ns = units, time.time_ns()
            self.positions += 1
            if self._index_pin and report.pins is not None:
                self._index_mark.update(units, self._index_pin in report.pins)
                self.lost = self.lost or self._index_mark.slip is not None
            if self._estimator.standing:
                self._units.set_turns(controller_units, units)
        return True

    def _position(self, report: StatusReport, in_inches: bool | None) -> float | None:
        """Return the machine position, None if the report is damaged or lacks it."""
        index = self._units.index
        try:
            inches = report.inches(index)
            # grblHAL and FluidNC report degrees with three decimals also where $13=1
            expected = in_inches and (inches or self._units.letter not in _ROTARY)
            if in_inches is not None and inches != expected:
                return None
            scale = _MM_PER_INCH if inches else 1.0
            if report.offset is not None:
                self._update_work_offset(report.offset[index] * scale)
            if report.machine is not None:
                return report.machine[index] * scale
            if report.work is None or self._work_offset is None:
                return None
            return report.work[index] * scale + self._work_offset
        except IndexError:
            # the controller has fewer axes, which open() reports, or the line is damaged
            return None

    def _update_work_offset(self, offset: float) -> None:
        """Accept the first offset, and another one if two reports agree on it."""
        if self._work_offset is None or offset == self._new_work_offset:
            self._work_offset = offset
        self._new_work_offset = offset

    def _use(
        self,
        report: StatusReport,
        units: float,
        times: tuple[float, float],
        waiting: bool,
        max_rate: float,
    ) -> bool:
        """Return whether the position was used."""
        held = self._is_held(report, units)
        if not held and report.state not in ('Idle', 'Alarm'):
            if self.commanded:
                return self._update_motion(units, times, waiting)
            return self._follow_hand(units, max_rate)
        if self._announced is not None or times[0] < self._commanded_at:
            return False
        overdue = self._estimator.has_ended(sum(times) / 2 - _END_DELAY)
        if not (self._estimator.standing or overdue or waiting):
            return False
        if overdue and not self._estimator.standing and not waiting:
            self._expected = self._estimator.target
        return self._update_standstill(units)

    def _is_held(self, report: StatusReport, units: float) -> bool:
        """Return whether the report says that a feed hold has come to standstill."""
        if report.state == 'Queue':
            return True
        if report.state != 'Hold':
            return False
        # GRBL 0.9 has no substate: the position has to be that of the report before
        before, self._held_at = self._held_at, units
        return before == units if report.substate is None else report.substate == 0

    def _update_motion(self, units: float, times: tuple[float, float], waiting: bool) -> bool:
        """Evaluate a report during a motion, which has to be the commanded one."""
        if self._announced is None and not waiting:
            plan = [
                self._estimator.state_at(times[0] - _MOTION_TIME_TOLERANCE)[0],
                self._estimator.state_at(times[1] + _MOTION_TIME_TOLERANCE)[0],
            ]
            low, high = min(plan) - _POSITION_TOLERANCE, max(plan) + _POSITION_TOLERANCE
            agrees = low <= units <= high or self._shift(sum(times) / 2, units)
            self._contradictions = 0 if agrees else self._contradictions + 1
            self.lost = self.lost or self._contradictions >= _MAX_CONTRADICTIONS
        self._estimator.update(sum(times) / 2, units)
        return self._contradictions == 0

    def _shift(self, time: float, units: float) -> bool:
        """Shift the plan if two reports in a row agree on its lateness; return whether they do."""
        before, self._lateness = self._lateness, self._estimator.lateness(time, units)
        if self._shifted or before is None or self._lateness is None:
            return False
        is_same = abs(self._lateness - before) <= _SHIFT_TOLERANCE
        is_begin = time - self._commanded_at <= _SHIFT_WITHIN
        if not (is_same and is_begin) or abs(self._lateness) > _MAX_SHIFT:
            return False
        self._estimator.delay(self._lateness)
        self._shifted = True
        return True

    def _follow_hand(self, units: float, max_rate: float) -> bool:
        """Follow an axis that is moved by a pendant or another program."""
        allowance = max_rate * _PENDANT_TIME + _POSITION_TOLERANCE
        if not self._confirm(units, self._estimator.target, allowance):
            return False
        self._standstill_unknown = True
        self._set_standstill(units)
        return True

    def _update_standstill(self, units: float) -> bool:
        """Evaluate the report of a standstill, which has to be where the last motion ended."""
        expected = self._expected
        if expected is None and self._estimator.standing and not self._standstill_unknown:
            expected = self._estimator.target
        if not self._confirm(units, expected, _POSITION_TOLERANCE):
            return False
        self.lost = self.lost or (
            expected is not None and abs(units - expected) > _POSITION_TOLERANCE
        )
        self._expected, self._standstill_unknown = None, False
        self._set_standstill(units)
        self.held = True
        return True

    def _confirm(self, units: float, expected: float | None, allowance: float) -> bool:
        """Return whether a position is the expected one, or two reports in a row agree on it."""
        before, self._unconfirmed = self._unconfirmed, None
        if expected is not None and abs(units - expected) <= allowance:
            return True
        if before is not None and abs(units - before) <= allowance:
            return True
        self._unconfirmed = units
        return False

    def _set_standstill(self, units: float) -> None:
        self._announced = None
        self._estimator.set_standstill(units)
