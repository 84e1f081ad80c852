# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is known of a GRBL board from what it said and from what it was told."""

from collections.abc import Callable
from collections.abc import Iterator
from collections.abc import Mapping
from contextlib import contextmanager
import threading
import time

from ivfmc_ros.devices.controller import BoardState
from ivfmc_ros.devices.grbl import protocol
from ivfmc_ros.devices.motion.axis_units import AxisUnits
from ivfmc_ros.devices.motion.position_estimator import Follower
from ivfmc_ros.devices.motion.ramp import Motion

POSITION_LOST = 'POSITION_LOST'
BOARD_LOST = 'BOARD_LOST'
CONNECTING = 'CONNECTING'

_ASK_MOVING, _ASK_STANDING, _ASK_WAITING = 0.125, 0.25, 0.06  # seconds from question to question
_SILENCE = 1.5  # seconds
_LATE = 0.3  # seconds after which a motion has ended although nobody said so
_ECHO = 0.3  # seconds in which a second banner belongs to the first
_TOLERANCE = 0.05  # board units between where a motion should end and where it did

# GRBL answers no question while it homes, and none after a limit switch was hit.
_MUTE = ('ALARM_1', 'ALARM_2')
_LETTERS = {'spindle': ('S', 'C'), 'coolant': ('F',)}


class GrblMonitor:
    """
    State of the board. Thread safe.

    lasers : name of each laser and its output
    """

    def __init__(self, units: AxisUnits, lasers: Mapping[str, str]) -> None:
        self._units = units
        self._outputs = lasers
        self._news = threading.Condition(threading.RLock())
        self.settings: dict[int, float] = {}
        self.alarm: str | None = BOARD_LOST
        self.lost = True
        self.locked = False
        self.lasers_ns = 0
        self._lasers = dict.fromkeys(lasers, False)
        self._follower = Follower()
        self._state = ''
        self._announced: Motion | None = None
        self._doubted = False
        self._known = False  # the position was reported since the port was opened
        self._landing: float | None = None  # board units where the last motion should have ended
        self._reported, self._reported_ns = 0.0, 0
        self._offset = 0.0
        self._asked, self._heard = 0.0, 0.0
        self._started = False
        self._start_expected_until = 0.0
        self._homing_until = 0.0
        self._waiting = False
        self._held = False
        self._reports = 0

    # -- what others ask

    @property
    def moving(self) -> bool:
        """The board moves, or was told to."""
        told = self._announced is not None or not self._follower.standing
        return told or self._state in ('Run', 'Jog', 'Home')

    @property
    def busy(self) -> bool:
        """
        The board has a reason not to answer a line yet.

        A move that was only announced is none: its own answer may have got lost.
        """
        runs = not self._follower.standing or self._state in ('Run', 'Jog', 'Hold')
        return self._homing or (runs and self.alarm in (None, CONNECTING))

    @property
    def silent(self) -> bool:
        """The board should have said something by now."""
        if self.lost or not self._started or self._homing or self.alarm in _MUTE:
            return False
        return self._asked - self._heard > _SILENCE

    @property
    def resting_units(self) -> float:
        """Where the axis stands, board units."""
        return self._follower.target

    def state(self) -> BoardState:
        """Return what is known now."""
        with self._news:
            position, velocity = self._follower.at(time.monotonic())
            radians = self._units.to_radians
            return BoardState(
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

    def wants_report(self) -> bool:
        """Tell whether to ask for a report now; whoever is told so asks."""
        now = time.monotonic()
        with self._news:
            pause = _ASK_MOVING if self.moving else _ASK_STANDING
            pause = _ASK_WAITING if self._waiting else pause
            if not self._started or self._homing or now - self._asked < pause:
                return False
            self._asked = now
            if self._heard < self._asked - 10 * _SILENCE:
                self._heard = now  # the first question after a pause
            return True

    # -- what is said by the board

    def hear(self, said: protocol.Line | None, began: float) -> None:
        """Take a report or setting; None is a garbled line, which proves no more than life."""
        with self._news:
            if isinstance(said, protocol.Setting):
                self.settings[said.number] = said.value
            elif isinstance(said, protocol.Report):
                self._heard = time.monotonic()
                self._take(said, began)
                self._reports += 1
            self._news.notify_all()

    def restarted(self) -> bool:
        """Tell whether the start that the board has just announced was expected."""
        with self._news:
            now = time.monotonic()
            expected = now < self._start_expected_until
            self._start_expected_until = min(self._start_expected_until, now + _ECHO)
            self._started, self._heard = True, now
            # a reset keeps the position of a table that stands; a new start does not
            known = self._known and self._follower.standing
            self._landing = self._follower.target if known else None
            self._stand(self._follower.at(now)[0])
            self.note_lasers({})
            if not expected:
                self.alarm = POSITION_LOST
            self._news.notify_all()
            return expected

    def alarmed(self, alarm: str) -> None:
        """The board raised an alarm, which has turned its outputs off."""
        with self._news:
            self.alarm, self.locked, self._state = alarm, True, 'Alarm'
            self._stand(self._follower.at(time.monotonic())[0])
            self.note_lasers({})
            self._news.notify_all()

    def lose(self) -> None:
        """The board cannot be reached."""
        with self._news:
            self.lost, self.alarm, self._started = True, BOARD_LOST, False
            self._stand(self._follower.at(time.monotonic())[0])
            self._news.notify_all()

    # -- what the board is told

    def connected(self) -> None:
        """The port is about to be opened, which resets many boards."""
        with self._news:
            self._started, self.lost, self.locked = False, False, False
            self.alarm = CONNECTING
            self.settings.clear()
            self._state, self._known = '', False
            self.expect_start()

    def expect_start(self) -> None:
        """The board is about to be reset."""
        with self._news:
            self._started = False
            self._start_expected_until = time.monotonic() + 6.0

    def announce(self, plan: Motion) -> None:
        """A move is about to be sent."""
        with self._news:
            self._announced, self._landing, self._doubted = plan, None, False

    def withdraw(self) -> None:
        """The move was not accepted."""
        with self._news:
            self._announced = None

    def begun(self) -> None:
        """The move was accepted; the board begins it when it finds no further line."""
        with self._news:
            if self._announced is not None:
                self._follower.begin(self._announced, time.monotonic())
                self._announced = None

    def drained(self) -> None:
        """All that was queued has been done."""
        with self._news:
            if not self._follower.standing:
                self._landing = self._follower.target
                self._state = 'Idle'
                self._stand(self._follower.target)
            self._news.notify_all()

    def braking(self, limit: float) -> None:
        """The board was told to hold; it brakes with ``limit``, board units per s^2."""
        with self._news:
            self._announced = None
            self._follower.brake(limit, time.monotonic())
            self._held, self._waiting = False, True

    def note_lasers(self, lit: Mapping[str, bool]) -> None:
        """The board acknowledged what is on; what is not named is off."""
        with self._news:
            lasers = {name: bool(lit.get(name)) for name in self._outputs}
            if lasers != self._lasers or not self.lasers_ns:
                self._lasers, self.lasers_ns = lasers, time.time_ns()

    def cleared(self) -> None:
        """Commands may be sent again: the board was unlocked, or homed."""
        with self._news:
            self.alarm, self.locked, self._landing = None, False, None

    @contextmanager
    def homing(self, seconds: float) -> Iterator[None]:
        """While the board homes, at most so long, it answers nothing."""
        self._homing_until = time.monotonic() + seconds
        try:
            yield
        finally:
            self._homing_until = 0.0
            self._heard = self._asked = time.monotonic()

    # -- waiting for the board

    def wait_start(self, seconds: float) -> bool:
        """Wait until the board has announced its start; False if it did not."""
        return self._wait(lambda: self._started or self.lost, seconds) and not self.lost

    def wait_report(self, seconds: float) -> bool:
        """Wait for a report that was asked for from now on."""
        with self._news:
            # one may be on its way already
            enough = self._reports + 1 + (self._asked > self._heard)
            self._waiting = True
        try:
            return self._wait(lambda: self._reports >= enough or self.lost, seconds)
        finally:
            self._waiting = False

    def wait_held(self, seconds: float) -> bool:
        """Wait until the board stands after ``braking``."""
        try:
            return self._wait(lambda: self._held or self.lost or self.locked, seconds)
        finally:
            self._waiting = False

    def _wait(self, condition: Callable[[], bool], seconds: float) -> bool:
        deadline = time.monotonic() + seconds
        with self._news:
            while not condition():
                if not self._news.wait(deadline - time.monotonic()):
                    return condition()
        return True

    # -- reports

    @property
    def _homing(self) -> bool:
        return time.monotonic() < self._homing_until

    def _take(self, report: protocol.Report, began: float) -> None:
        units = self._position(report)
        if units is None:
            return
        self._state, self._known = report.state, True
        units = self._units.unwrap(units, self._follower.at(time.monotonic())[0])
        self._reported, self._reported_ns = units, time.time_ns()
        self._follow(report, units, (self._asked + max(began, self._asked)) / 2)
        self._judge_state(report)
        if report.outputs is not None:
            self._judge_outputs(report.outputs)

    def _position(self, report: protocol.Report) -> float | None:
        index = self._units.index
        try:
            if report.offset is not None:
                self._offset = report.offset[index]
            if report.machine is not None:
                return report.machine[index]
            return None if report.work is None else report.work[index] + self._offset
        except IndexError:
            # the board has fewer axes, which open() says, or the line was garbled
            return None

    def _follow(self, report: protocol.Report, units: float, time_s: float) -> None:
        standing = report.state in ('Idle', 'Alarm') or (report.state, report.substate) == (
            'Hold',
            0,
        )
        if not standing:
            if self._follower.standing and self._announced is None:
                self._stand(units)  # somebody else moves the axis
            else:
                self._follower.report(time_s, units)
            return
        late = self._follower.ended(time_s - _LATE)
        if self._announced is None and (self._follower.standing or late or self._waiting):
            if late and not self._follower.standing and not self._waiting:
                self._landing = self._follower.target
            if self._landing is not None and abs(units - self._landing) > _TOLERANCE:
                if not self._doubted:
                    # a digit may have got lost: the next report decides
                    self._doubted = True
                    return
                self.alarm = self.alarm or POSITION_LOST
            self._doubted = False
            self._landing = None
            self._stand(units)
            self._held = True

    def _stand(self, units: float) -> None:
        self._announced = None
        self._follower.rest(units)

    def _judge_state(self, report: protocol.Report) -> None:
        if report.state == 'Alarm':
            self.locked = True
            self.alarm = 'LOCKED' if self.alarm in (None, CONNECTING) else self.alarm
        elif report.state in ('Door', 'Check', 'Sleep'):
            self.alarm = self.alarm or report.state.upper()
        elif report.state == 'Hold' and not self._waiting:
            # somebody pressed the button of the board
            self.alarm = self.alarm or 'HOLD'

    def _judge_outputs(self, letters: str) -> None:
        lit = {
            name: any(letter in letters for letter in _LETTERS[output])
            for name, output in self._outputs.items()
        }
        unexpected = [name for name in lit if lit[name] and not self._lasers[name]]
        settled = time.time_ns() - self.lasers_ns > 1_000_000_000
        if unexpected and settled and not self._waiting:
            self.alarm = self.alarm or 'LASER_UNEXPECTED'
            self.note_lasers(lit)
