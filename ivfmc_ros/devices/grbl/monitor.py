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
import math
import threading
import time

from ivfmc_ros.devices.controller import CONNECTING
from ivfmc_ros.devices.controller import CONTROLLER_LOST
from ivfmc_ros.devices.controller import ControllerState
from ivfmc_ros.devices.controller import POSITION_LOST
from ivfmc_ros.devices.grbl import protocol
from ivfmc_ros.devices.grbl.axis_tracker import AxisTracker
from ivfmc_ros.devices.grbl.dialects import Dialect
from ivfmc_ros.devices.grbl.dialects import DIALECTS
from ivfmc_ros.devices.grbl.dialects import MAX_RATE
from ivfmc_ros.devices.grbl.dialects import REPORT_INCHES
from ivfmc_ros.devices.grbl.setting_readings import SettingReadings
from ivfmc_ros.devices.grbl.status_queries import StatusQueries
from ivfmc_ros.devices.motion.axis_units import AxisUnits
from ivfmc_ros.devices.motion.trajectory import Trajectory

_START_TIMEOUT = 6.0  # seconds after a reset in which a banner is expected; boot loaders take 4
_REPEATED_BANNER = 0.3  # seconds in which a second banner belongs to the same start
_OUTPUT_DELAY = 1.0  # seconds; reports of outputs lag behind a command

# GRBL sends no reports after a limit switch was hit (alarms 1 and 2), nor while it homes.
_ALARMS_WITHOUT_REPORTS = ('ALARM_1', 'ALARM_2')
_OUTPUT_LETTERS: Mapping[str, tuple[str, ...]] = {'spindle': ('S', 'C'), 'coolant': ('F',)}


class GrblMonitor:
    """
    State of the controller: connection, alarm, position, outputs. Thread safe.

    units : of the axis that turns the table
    lasers : output of each laser by its name
    index : pin of the index mark, '' without one
    readings : of the controller's ``$`` settings
    settings : values of these settings by number, each read twice
    banner : of the controller; None before, and for a controller that sends none
    dialect : of the controller's firmware
    identity : what the controller told about itself, by key, as AXS of ``[AXS:4:XYZA]``
    axis_count : number of axes in the reports, 0 before the first one
    homed : the position is that of the home switch, or was accepted by the operator
    alarm : see ControllerState.alarm
    lost : the port is closed or failed, or the controller is silent
    locked : GRBL accepts no motion until it is homed or unlocked
    lasers_ns : when the last change of a laser was acknowledged, nanoseconds since the epoch
    """

    def __init__(self, units: AxisUnits, lasers: Mapping[str, str], index: str = '') -> None:
        self._units = units
        self._outputs = lasers
        self._changed = threading.Condition(threading.RLock())
        self.readings = SettingReadings()
        self.settings: dict[int, float] = {}
        self.banner: protocol.Banner | None = None
        self.dialect: Dialect = DIALECTS['Grbl']
        self.identity: dict[str, str] = {}
        self.axis_count = 0
        self.homed = False
        self.alarm: str | None = CONTROLLER_LOST
        self.lost = True
        self.locked = False
        self.lasers_ns = 0
        self._lasers = dict.fromkeys(lasers, False)
        self._axis = AxisTracker(units, index)
        self._state = ''
        self._queries = StatusQueries()
        self._started = False
        self._start_expected_until = 0.0
        self._homing_until = 0.0
        self._waiting = False
        self._report_count = 0
        self._lasers_changed_at = 0.0  # monotonic seconds

    # -- state

    @property
    def moving(self) -> bool:
        """Whether the axis moves, or a move was sent."""
        return self._axis.commanded or self._state in ('Run', 'Jog', 'Home')

    @property
    def is_busy(self) -> bool:
        """
        Whether the controller has a reason not to respond to a line yet.

        A move that was sent but not accepted is no reason: its own response may be lost.
        """
        running = not self._axis.standing or self._state in ('Run', 'Jog', 'Hold')
        return self._homing or (running and self.alarm in (None, CONNECTING))

    @property
    def is_silent(self) -> bool:
        """Whether a status query has stayed without report for too long."""
        if self.lost or not self._started or self._homing or self.alarm in _ALARMS_WITHOUT_REPORTS:
            return False
        return self._queries.are_silent(lit=self._is_lit)

    @property
    def _is_lit(self) -> bool:
        return any(self._lasers.values())

    @property
    def target_units(self) -> float:
        """Where the axis stands, or the motion ends, controller units."""
        return self._axis.target

    def state(self) -> ControllerState:
        """Return the state as estimated now."""
        with self._changed:
            position, velocity = self._axis.state_at(time.monotonic())
            radians = self._units.to_radians
            return ControllerState(
                stamp_ns=time.time_ns(),
                position=radians(position),
                velocity=radians(velocity) - radians(0.0),
                reported=radians(self._axis.reported),
                reported_ns=self._axis.reported_ns,
                moving=self.moving,
                alarm=self.alarm,
                lasers=dict(self._lasers),
                lasers_ns=self.lasers_ns,
                homed=self.homed,
                firmware=self.firmware,
                index_mark=self._axis.index_text,
            )

    @property
    def firmware(self) -> str:
        """Name and version of the firmware, '' before the connection."""
        if self.lost or not self._started:
            return ''
        version = self.banner.version if self.banner else ''
        return f'{self.dialect.name.split()[0]} {version}'.strip()

    def query_due(self) -> bool:
        """Return whether a status query is due, and if so note it as sent: the caller sends it."""
        now = time.monotonic()
        with self._changed:
            if not self._started or self._homing:
                return False
            is_active = self.moving or self._is_lit
            return self._queries.due(now, waiting=self._waiting, active=is_active)

    # -- lines from the controller

    def handle_line(self, line: protocol.Line | None, received_at: float) -> None:
        """
        Evaluate a report or setting; other lines are ignored.

        line : None for a damaged line
        received_at : monotonic second of the line's first byte
        """
        with self._changed:
            if isinstance(line, protocol.Setting):
                self._handle_setting(line)
            elif isinstance(line, protocol.Feedback):
                self.identity[line.key] = line.value
            elif isinstance(line, protocol.StatusReport):
                self._queries.hear(time.monotonic())
                self._handle_report(line, received_at)
                self._report_count += 1
            self._changed.notify_all()

    def _handle_setting(self, line: protocol.Setting) -> None:
        number = self.dialect.number(line.key, self._units.letter, self._units.index)
        if number is not None and not math.isnan(line.value):
            self.readings.add(number, line.value)

    def handle_banner(self, banner: protocol.Banner) -> bool:
        """Note that the controller has started; return whether that was expected."""
        with self._changed:
            if banner.version or self.banner is None:
                self.banner = banner
            now = time.monotonic()
            expected = now < self._start_expected_until
            self._start_expected_until = min(self._start_expected_until, now + _REPEATED_BANNER)
            self._started = True
            self._queries.hear(now)
            self._axis.interrupt(now, keeps_position=True)
            self.set_lasers({})
            if not expected:
                self.alarm, self.homed = POSITION_LOST, False
            self._changed.notify_all()
            return expected

    def handle_alarm(self, alarm: str) -> None:
        """Note an alarm, with which the controller has turned its outputs off."""
        with self._changed:
            # a controller that is lost stays lost: clear_alarm has to connect again
            self.alarm = self.alarm if self.lost else alarm
            self.homed = False
            self.locked, self._state = True, 'Alarm'
            self._axis.interrupt(time.monotonic())
            self.set_lasers({})
            self._changed.notify_all()

    def set_lost(self) -> None:
        """Note that the controller cannot be reached."""
        with self._changed:
            self.lost, self.alarm, self._started = True, CONTROLLER_LOST, False
            self.homed = False
            self._axis.interrupt(time.monotonic())
            self._changed.notify_all()

    # -- commands to the controller

    def begin_connection(self) -> None:
        """Prepare for the opening of the port, which resets many controllers."""
        with self._changed:
            self._started, self.lost, self.locked = False, False, False
            self.alarm = CONNECTING
            self.settings, self.banner, self.dialect = {}, None, DIALECTS['Grbl']
            self.identity, self.axis_count, self.homed = {}, 0, False
            self.readings.clear()
            self._state = ''
            self._axis.begin_connection()
            self.expect_start()

    def expect_start(self) -> None:
        """Prepare for a reset: a banner follows."""
        with self._changed:
            self._started = False
            self._start_expected_until = time.monotonic() + _START_TIMEOUT

    def end_start(self) -> None:
        """Note that the controller has answered since its start: another banner is a restart."""
        with self._changed:
            self._start_expected_until = 0.0

    def assume_started(self) -> None:
        """Note that the controller runs, though it sends no banner after a reset."""
        with self._changed:
            self._started = True
            self._queries.forget()
            self._axis.interrupt(time.monotonic(), keeps_position=True)
            self.set_lasers({})

    def announce_move(self, plan: Trajectory) -> None:
        """Note a move that is about to be sent."""
        with self._changed:
            self._axis.announce(plan)

    def withdraw_move(self) -> None:
        """Note that the announced move was not accepted."""
        with self._changed:
            self._axis.withdraw()

    def begin_move(self) -> None:
        """Note that the announced move was accepted: it begins now."""
        with self._changed:
            self._axis.begin(time.monotonic())

    def end_move(self) -> None:
        """Note that the motion has ended at its target."""
        with self._changed:
            if self._axis.end(time.monotonic()):
                self._state = 'Idle'
            self._changed.notify_all()

    def begin_hold(self, deceleration: float) -> None:
        """Note that a feed hold was sent; ``deceleration`` in controller units per s^2."""
        with self._changed:
            self._axis.brake(deceleration, time.monotonic())
            self._waiting = True

    def set_lasers(self, on: Mapping[str, bool]) -> None:
        """Note which lasers are on, as acknowledged; lasers that are not named are off."""
        with self._changed:
            lasers = {name: bool(on.get(name)) for name in self._outputs}
            if lasers != self._lasers or not self.lasers_ns:
                self._lasers, self.lasers_ns = lasers, time.time_ns()
                self._lasers_changed_at = time.monotonic()

    def clear_alarm(self) -> None:
        """Note that the controller was unlocked or homed."""
        with self._changed:
            self.alarm, self.locked = None, False
            # the operator accepts the position that is reported
            self._axis.forget_standstill()

    @contextmanager
    def homing(self, seconds: float) -> Iterator[None]:
        """Expect no reports inside of the block, for at most ``seconds``: the controller homes."""
        self._homing_until = time.monotonic() + seconds
        try:
            yield
        finally:
            self._homing_until = 0.0
            self._queries.resume(time.monotonic())

    # -- waiting

    def wait_for_start(self, seconds: float) -> bool:
        """Wait for the banner of the controller; return whether it came."""
        return self._wait(lambda: self._started or self.lost, seconds) and not self.lost

    def wait_for_report(self, seconds: float) -> bool:
        """Wait for the report to a query sent from now on; return whether it came."""
        with self._changed:
            # the report to an earlier query may arrive first
            needed = self._report_count + 1 + self._queries.are_unanswered
        return self._wait_for_query(lambda: self._report_count >= needed, seconds)

    def wait_for_position(self, seconds: float) -> bool:
        """Wait for a position that is reported from now on; return whether it came."""
        with self._changed:
            needed = self._axis.positions + 1 + self._queries.are_unanswered
        return self._wait_for_query(lambda: self._axis.positions >= needed, seconds)

    def _wait_for_query(self, condition: Callable[[], bool], seconds: float) -> bool:
        self._waiting = True
        try:
            return self._wait(lambda: condition() or self.lost, seconds) and not self.lost
        finally:
            self._waiting = False

    def wait_for_hold(self, seconds: float) -> bool:
        """Wait until the axis stands after ``begin_hold``; return whether it does."""
        try:
            return self._wait(lambda: self._axis.held or self.lost or self.locked, seconds)
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
        self.axis_count = len(report.decimals)
        in_inches = self.settings.get(REPORT_INCHES)
        has_position = self._axis.update(
            report,
            (self._queries.queried_at, max(received_at, self._queries.queried_at)),
            waiting=self._waiting,
            in_inches=None if in_inches is None else bool(in_inches),
            max_rate=self.settings.get(MAX_RATE + self._units.index, 0.0) / 60,
        )
        if not has_position:
            return
        self._state = report.state
        if self._axis.lost:
            self.alarm, self.homed = self.alarm or POSITION_LOST, False
        self._update_alarm(report)
        if report.outputs is not None:
            self._check_outputs(report.outputs)

    def _update_alarm(self, report: protocol.StatusReport) -> None:
        if report.state == 'Alarm':
            self.locked = True
            self.alarm = 'LOCKED' if self.alarm in (None, CONNECTING) else self.alarm
        elif report.state in ('Door', 'Check', 'Sleep'):
            self.alarm = self.alarm or report.state.upper()
        elif report.state in ('Hold', 'Tool') and not self._waiting:
            # the hold button of the controller was pressed, or it waits for a tool
            self.alarm = self.alarm or report.state.upper()

    def _check_outputs(self, letters: str) -> None:
        on = {
            name: any(letter in letters for letter in _OUTPUT_LETTERS.get(output, ()))
            for name, output in self._outputs.items()
        }
        unexpected = [name for name in on if on[name] and not self._lasers[name]]
        settled = time.monotonic() - self._lasers_changed_at > _OUTPUT_DELAY
        if unexpected and settled and not self._waiting:
            self.alarm = self.alarm or 'LASER_UNEXPECTED'
            self.set_lasers(on)
