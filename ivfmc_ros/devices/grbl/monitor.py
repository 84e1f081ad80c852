# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
State of a GRBL controller, estimated from the lines it sends and the commands it accepted.

The monitor sends nothing: the reading thread feeds lines into it, ``GrblController`` feeds
commands into it, and both read the state.
"""

from collections.abc import Callable
from collections.abc import Iterator
from collections.abc import Mapping
from contextlib import contextmanager
import threading
import time

from ivfmc_ros.devices.controller import CONNECTING
from ivfmc_ros.devices.controller import CONTROLLER_LOST
from ivfmc_ros.devices.controller import ControllerState
from ivfmc_ros.devices.controller import POSITION_LOST
from ivfmc_ros.devices.grbl import protocol
from ivfmc_ros.devices.motion.axis_units import AxisUnits
from ivfmc_ros.devices.motion.position_estimator import PositionEstimator
from ivfmc_ros.devices.motion.trajectory import Trajectory

# Seconds between status queries. GRBL's interface description allows 5 to 10 a second.
_QUERY_PERIOD_MOVING = 0.125
_QUERY_PERIOD_STANDING = 0.25
_QUERY_PERIOD_WAITING = 0.06  # short, while a command waits for a report
_SILENCE_TIMEOUT = 1.5  # seconds without a report after a query until the controller is lost
_START_TIMEOUT = 6.0  # seconds after a reset in which a banner is expected; boot loaders take 4
_REPEATED_BANNER = 0.3  # seconds in which a second banner belongs to the same start
_END_DELAY = 0.3  # seconds after its planned end until a motion counts as ended without response
_POSITION_TOLERANCE = 0.05  # controller units from the target, eight steps of the bench table
_OUTPUT_DELAY_NS = 1_000_000_000  # nanoseconds; reports of outputs lag behind a command

# GRBL sends no reports after a limit switch was hit (alarms 1 and 2), nor while it homes.
_ALARMS_WITHOUT_REPORTS = ('ALARM_1', 'ALARM_2')
_OUTPUT_LETTERS = {'spindle': ('S', 'C'), 'coolant': ('F',)}


class GrblMonitor:
    """
    State of the controller: connection, alarm, position, outputs. Thread safe.

    units : of the axis that turns the table
    lasers : output of each laser by its name
    settings : values of the controller's ``$`` settings by number
    alarm : see ControllerState.alarm
    lost : the port is closed or failed, or the controller is silent
    locked : GRBL accepts no motion until it is homed or unlocked
    lasers_ns : when the last change of a laser was acknowledged, nanoseconds since the epoch
    """

    def __init__(self, units: AxisUnits, lasers: Mapping[str, str]) -> None:
        self._units = units
        self._outputs = lasers
        self._changed = threading.Condition(threading.RLock())
        self.settings: dict[int, float] = {}
        self.alarm: str | None = CONTROLLER_LOST
        self.lost = True
        self.locked = False
        self.lasers_ns = 0
        self._lasers = dict.fromkeys(lasers, False)
        self._estimator = PositionEstimator()
        self._state = ''
        self._announced: Trajectory | None = None  # sent, not accepted yet
        self._target_missed_once = False
        self._position_known = False  # a position was reported since the port was opened
        self._expected_position: float | None = None  # units at which the last motion should end
        self._reported, self._reported_ns = 0.0, 0
        self._work_offset = 0.0  # controller units, machine minus work position
        self._queried_at, self._heard_at = 0.0, 0.0  # monotonic seconds
        self._started = False
        self._start_expected_until = 0.0
        self._homing_until = 0.0
        self._waiting = False
        self._held = False
        self._report_count = 0

    # -- state

    @property
    def moving(self) -> bool:
        """Whether the axis moves, or a move was sent."""
        commanded = self._announced is not None or not self._estimator.standing
        return commanded or self._state in ('Run', 'Jog', 'Home')

    @property
    def is_busy(self) -> bool:
        """
        Whether the controller has a reason not to respond to a line yet.

        A move that was sent but not accepted is no reason: its own response may be lost.
        """
        running = not self._estimator.standing or self._state in ('Run', 'Jog', 'Hold')
        return self._homing or (running and self.alarm in (None, CONNECTING))

    @property
    def is_silent(self) -> bool:
        """Whether a status query has stayed without report for too long."""
        if self.lost or not self._started or self._homing or self.alarm in _ALARMS_WITHOUT_REPORTS:
            return False
        return self._queried_at - self._heard_at > _SILENCE_TIMEOUT

    @property
    def target_units(self) -> float:
        """Where the axis stands, or the motion ends, controller units."""
        return self._estimator.target

    def state(self) -> ControllerState:
        """Return the state as estimated now."""
        with self._changed:
            position, velocity = self._estimator.state_at(time.monotonic())
            radians = self._units.to_radians
            return ControllerState(
                stamp_ns=time.time_ns(),
                position=radians(position),
                velocity=radians(velocity) - radians(0.0),
                reported=radians(self._reported),
                reported_ns=self._reported_ns,
                moving=self.moving,
                alarm=self.alarm,
                lasers=dict(self._lasers),
                lasers_ns=self.lasers_ns,
            )

    def query_due(self) -> bool:
        """Return whether a status query is due, and if so note it as sent: the caller sends it."""
        now = time.monotonic()
        with self._changed:
            period = _QUERY_PERIOD_MOVING if self.moving else _QUERY_PERIOD_STANDING
            period = _QUERY_PERIOD_WAITING if self._waiting else period
            if not self._started or self._homing or now - self._queried_at < period:
                return False
            self._queried_at = now
            if self._heard_at < now - 10 * _SILENCE_TIMEOUT:
                self._heard_at = now  # the first query after a pause
            return True

    # -- lines from the controller

    def handle_line(self, line: protocol.Line | None, received_at: float) -> None:
        """
        Evaluate a report or setting; other lines are ignored.

        line : None for a damaged line
        received_at : monotonic second of the line's first byte
        """
        with self._changed:
            if isinstance(line, protocol.Setting):
                self.settings[line.number] = line.value
            elif isinstance(line, protocol.StatusReport):
                self._heard_at = time.monotonic()
                self._handle_report(line, received_at)
                self._report_count += 1
            self._changed.notify_all()

    def handle_banner(self) -> bool:
        """Note that the controller has started; return whether that was expected."""
        with self._changed:
            now = time.monotonic()
            expected = now < self._start_expected_until
            self._start_expected_until = min(self._start_expected_until, now + _REPEATED_BANNER)
            self._started, self._heard_at = True, now
            # a reset keeps the position of a standing table; a power-on does not
            known = self._position_known and self._estimator.standing
            self._expected_position = self._estimator.target if known else None
            self._set_standstill(self._estimator.state_at(now)[0])
            self.set_lasers({})
            if not expected:
                self.alarm = POSITION_LOST
            self._changed.notify_all()
            return expected

    def handle_alarm(self, alarm: str) -> None:
        """Note an alarm, with which the controller has turned its outputs off."""
        with self._changed:
            self.alarm, self.locked, self._state = alarm, True, 'Alarm'
            self._set_standstill(self._estimator.state_at(time.monotonic())[0])
            self.set_lasers({})
            self._changed.notify_all()

    def set_lost(self) -> None:
        """Note that the controller cannot be reached."""
        with self._changed:
            self.lost, self.alarm, self._started = True, CONTROLLER_LOST, False
            self._set_standstill(self._estimator.state_at(time.monotonic())[0])
            self._changed.notify_all()

    # -- commands to the controller

    def begin_connection(self) -> None:
        """Prepare for the opening of the port, which resets many controllers."""
        with self._changed:
            self._started, self.lost, self.locked = False, False, False
            self.alarm = CONNECTING
            self.settings.clear()
            self._state, self._position_known = '', False
            self.expect_start()

    def expect_start(self) -> None:
        """Prepare for a reset: a banner follows."""
        with self._changed:
            self._started = False
            self._start_expected_until = time.monotonic() + _START_TIMEOUT

    def announce_move(self, plan: Trajectory) -> None:
        """Note a move that is about to be sent."""
        with self._changed:
            self._announced, self._expected_position, self._target_missed_once = plan, None, False

    def withdraw_move(self) -> None:
        """Note that the announced move was not accepted."""
        with self._changed:
            self._announced = None

    def begin_move(self) -> None:
        """Note that the announced move was accepted: it begins now."""
        with self._changed:
            if self._announced is not None:
                self._estimator.begin(self._announced, time.monotonic())
                self._announced = None

    def end_move(self) -> None:
        """Note that the motion has ended at its target."""
        with self._changed:
            if not self._estimator.standing:
                self._expected_position = self._estimator.target
                self._state = 'Idle'
                self._set_standstill(self._estimator.target)
            self._changed.notify_all()

    def begin_hold(self, deceleration: float) -> None:
        """Note that a feed hold was sent; ``deceleration`` in controller units per s^2."""
        with self._changed:
            self._announced = None
            self._estimator.brake(deceleration, time.monotonic())
            self._held, self._waiting = False, True

    def set_lasers(self, on: Mapping[str, bool]) -> None:
        """Note which lasers are on, as acknowledged; lasers that are not named are off."""
        with self._changed:
            lasers = {name: bool(on.get(name)) for name in self._outputs}
            if lasers != self._lasers or not self.lasers_ns:
                self._lasers, self.lasers_ns = lasers, time.time_ns()

    def clear_alarm(self) -> None:
        """Note that the controller was unlocked or homed."""
        with self._changed:
            self.alarm, self.locked, self._expected_position = None, False, None

    @contextmanager
    def homing(self, seconds: float) -> Iterator[None]:
        """Expect no reports inside of the block, for at most ``seconds``: the controller homes."""
        self._homing_until = time.monotonic() + seconds
        try:
            yield
        finally:
            self._homing_until = 0.0
            self._heard_at = self._queried_at = time.monotonic()

    # -- waiting

    def wait_for_start(self, seconds: float) -> bool:
        """Wait for the banner of the controller; return whether it came."""
        return self._wait(lambda: self._started or self.lost, seconds) and not self.lost

    def wait_for_report(self, seconds: float) -> bool:
        """Wait for the report to a query sent from now on; return whether it came."""
        with self._changed:
            # the report to an earlier query may arrive first
            needed = self._report_count + 1 + (self._queried_at > self._heard_at)
            self._waiting = True
        try:
            return self._wait(lambda: self._report_count >= needed or self.lost, seconds)
        finally:
            self._waiting = False

    def wait_for_hold(self, seconds: float) -> bool:
        """Wait until the axis stands after ``begin_hold``; return whether it does."""
        try:
            return self._wait(lambda: self._held or self.lost or self.locked, seconds)
        finally:
            self._waiting = False

    def _wait(self, condition: Callable[[], bool], seconds: float) -> bool:
        deadline = time.monotonic() + seconds
        with self._changed:
            while not condition():
                if not self._changed.wait(deadline - time.monotonic()):
                    return condition()
        return True

    # -- evaluation of reports

    @property
    def _homing(self) -> bool:
        return time.monotonic() < self._homing_until

    def _handle_report(self, report: protocol.StatusReport, received_at: float) -> None:
        controller_units = self._position(report)
        if controller_units is None:
            return
        self._state, self._position_known = report.state, True
        expected = self._estimator.state_at(time.monotonic())[0]
        units = self._units.unwrap(controller_units, expected)
        self._reported, self._reported_ns = units, time.time_ns()
        # the position was taken between query and report
        time_s = (self._queried_at + max(received_at, self._queried_at)) / 2
        self._update_position(report, units, time_s)
        self._update_alarm(report)
        if report.outputs is not None:
            self._check_outputs(report.outputs)

    def _position(self, report: protocol.StatusReport) -> float | None:
        index = self._units.index
        try:
            if report.offset is not None:
                self._work_offset = report.offset[index]
            if report.machine is not None:
                return report.machine[index]
            return None if report.work is None else report.work[index] + self._work_offset
        except IndexError:
            # the controller has fewer axes, which open() reports, or the line is damaged
            return None

    def _update_position(self, report: protocol.StatusReport, units: float, time_s: float) -> None:
        held = report.state == 'Hold' and report.substate == 0
        if not held and report.state not in ('Idle', 'Alarm'):
            if self._estimator.standing and self._announced is None:
                self._set_standstill(units)  # moved by a pendant or another program
            else:
                self._estimator.update(time_s, units)
            return
        overdue = self._estimator.has_ended(time_s - _END_DELAY)
        if self._announced is not None:
            return
        if not (self._estimator.standing or overdue or self._waiting):
            return
        if overdue and not self._estimator.standing and not self._waiting:
            self._expected_position = self._estimator.target
        expected = self._expected_position
        if expected is not None and abs(units - expected) > _POSITION_TOLERANCE:
            if not self._target_missed_once:
                # a digit may be damaged: the next report decides
                self._target_missed_once = True
                return
            self.alarm = self.alarm or POSITION_LOST
        self._target_missed_once = False
        self._expected_position = None
        self._set_standstill(units)
        self._held = True

    def _set_standstill(self, units: float) -> None:
        self._announced = None
        self._estimator.set_standstill(units)

    def _update_alarm(self, report: protocol.StatusReport) -> None:
        if report.state == 'Alarm':
            self.locked = True
            self.alarm = 'LOCKED' if self.alarm in (None, CONNECTING) else self.alarm
        elif report.state in ('Door', 'Check', 'Sleep'):
            self.alarm = self.alarm or report.state.upper()
        elif report.state == 'Hold' and not self._waiting:
            # the hold button of the controller was pressed
            self.alarm = self.alarm or 'HOLD'

    def _check_outputs(self, letters: str) -> None:
        on = {
            name: any(letter in letters for letter in _OUTPUT_LETTERS[output])
            for name, output in self._outputs.items()
        }
        unexpected = [name for name in on if on[name] and not self._lasers[name]]
        settled = time.time_ns() - self.lasers_ns > _OUTPUT_DELAY_NS
        if unexpected and settled and not self._waiting:
            self.alarm = self.alarm or 'LASER_UNEXPECTED'
            self.set_lasers(on)
