# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Motion controller with Marlin: a rotary axis, lasers on fan or spindle outputs.

``ok`` to a move means queued. The steps that ``M114`` counts are where the motor is; a move has
ended when they are those of its target. ``M410`` ends the motion at once and keeps the position of
the motor, unless it skips steps because it does not brake.
"""

from collections.abc import Mapping
import time

from ivfmc_ros.devices.controller import CONNECTING
from ivfmc_ros.devices.marlin import protocol
from ivfmc_ros.devices.prompt.controller import PromptController
from ivfmc_ros.errors import ControllerLostError
from ivfmc_ros.errors import ControllerRefusedError
from ivfmc_ros.errors import DeviceError

_START_S = 3.0  # seconds from opening the port to ``start``; a boot loader takes two of them
_SETTLE_S = 0.3  # seconds of the messages that follow ``start``
_PERIOD_MOVING, _PERIOD_STANDING = 0.1, 0.5  # seconds between questions for the position
_PERIOD_S = 0.02  # seconds between looks for the start
# Seconds without an answer until the controller is lost: the host keepalive comes every 2 s.
_SILENCE_S = 3.0
_STEPS_TOLERANCE = 1  # steps from the target: rounding of the planner
_OVERDUE_S = (
    1.0  # seconds after its planned end until a motion that does not reach its target is lost
)
_HAND_STEPS = 2  # steps by which a standing axis may differ from its position
_ALARM_HALTED = 'HALTED'


class MarlinController(PromptController):
    """A MotionController that runs Marlin; see there for its methods."""

    OUTPUTS: Mapping[str, tuple[str, str]] = {
        'spindle': ('M3 S{power}', 'M5'),
        **{f'fan{n}': (f'M106 P{n} S{{power}}', f'M107 P{n}') for n in range(4)},
    }
    # the new line ends a command that was cut off; M410 is executed at once
    OFF_STEPS = ((b'\nM410\nM107 P0\nM107 P1\nM107 P2\nM107 P3\nM5\n', 0.0),)

    def home(self) -> None:
        """
        Search the home switch, which defines position 0.

        :raises ControllerRefusedError: the controller is locked for good
        """
        with self._command_lock:
            self._require_connected()
            self._switch(None)
            letter = self._units.letter
            self._line.request(f'G28 {letter}', seconds=self._settings.home_timeout, attempts=1)
            # homing switches the limits of the travel on, beyond which the table could not turn
            self._line.request('M211 S0')
            units = self._ask_position()
            self._units.set_turns(units, units)
            with self._changed:
                self._alarm, self._homed = None, True
            self._stand(units)

    # -- what Marlin does differently

    def _is_end(self, text: str) -> bool:
        return protocol.is_end(text)

    def _is_busy(self, text: str) -> bool:
        return protocol.is_busy(text)

    def _handle_line(self, text: str) -> None:
        if protocol.is_start(text):
            self._started = True
            self._lose_position()
            self._line.abort(DeviceError('the controller restarted by itself'))
        elif protocol.is_halt(text):
            self._set_alarm(_ALARM_HALTED)
            self._set_lasers(None)
            self._line.abort(DeviceError(f'the controller has stopped: {text}'))
        elif not protocol.is_understood(text):
            self._unknown.add(text)

    def _connect(self) -> None:
        self._started, self._asked_at, self._overdue_at = False, 0.0, 0.0
        # a controller that was asked before has started
        wait = _SETTLE_S if self._line.serial.adopted else _START_S
        deadline = time.monotonic() + wait
        while not self._started and time.monotonic() < deadline:
            time.sleep(_PERIOD_S)
        time.sleep(_SETTLE_S)
        answer = self._line.request('M115')
        self._firmware = next((name for line in answer if (name := protocol.parse_name(line))), '')
        if not self._firmware:
            raise ControllerLostError(
                f'port {self._settings.port}: M115 names no firmware; received: {answer[:3]}'
            )
        for command in ('G21', 'G90', 'M17', 'M211 S0'):
            self._line.request(command)
        self._units.choose(self._settings.axis, ''.join(self._ask().steps))
        self._read_limits()
        self._stand(self._ask_position())

    def _read_limits(self) -> None:
        """:raises ControllerRefusedError: M503 does not list what a move needs"""
        listed: dict[str, dict[str, float]] = {}
        for line in self._line.request('M503'):
            if setting := protocol.parse_setting(line):
                listed.setdefault(setting[0], {}).update(setting[1])
        letter = self._units.letter
        values = {code: listed.get(code, {}).get(letter, 0.0) for code in ('M92', 'M203', 'M201')}
        missing = [code for code, value in values.items() if not value > 0.0]
        if missing:
            raise ControllerRefusedError(
                f'M503: lists no {missing[0]} {letter}; the firmware needs its settings (M503)'
            )
        self._steps_per_unit = values['M92']
        self._limits = values['M203'], values['M201']
        self._acceleration = 0.0  # of the last M204

    def _begin(self, target: float, velocity: float, acceleration: float) -> None:
        if acceleration != self._acceleration:
            self._line.request(f'M204 P{acceleration:.3f} T{acceleration:.3f}')
            self._acceleration = acceleration
        position = self._units.to_controller(target)
        self._target_steps = round(position * self._steps_per_unit)
        self._plan(self._trapezoid(target, velocity, acceleration))
        self._overdue_at = 0.0
        # written once: a move that is sent twice ends at the same target
        self._line.request(f'G1 {self._units.letter}{position:.4f} F{60 * velocity:.3f}')

    def _halt(self) -> None:
        self._line.serial.write(b'M410\n')
        with self._command_lock:
            # the answer to M410 was one without a request
            time.sleep(_PERIOD_S)
            before = self._ask_position()
            while (now := self._ask_position()) != before:
                before = now
            self._stand(before)

    def _work(self) -> None:
        standing = self._estimator.standing
        period = _PERIOD_STANDING if standing else _PERIOD_MOVING
        asked_at = time.monotonic()
        if asked_at - self._asked_at < period or self._alarm in (CONNECTING, _ALARM_HALTED):
            return
        self._asked_at = asked_at
        number = self._moves
        steps = self._ask().steps[self._units.letter]
        answered_at = time.monotonic()
        with self._changed:
            # a position that was asked for before a command tells nothing about it
            if number == self._moves and standing == self._estimator.standing:
                self._evaluate(steps, (asked_at + answered_at) / 2)

    def _evaluate(self, steps: int, at: float) -> None:
        expected = self._estimator.state_at(at)[0]
        units = self._units.unwrap(steps / self._steps_per_unit, expected)
        self._reported, self._reported_ns = units, time.time_ns()
        if self._estimator.standing:
            if abs(units - expected) * self._steps_per_unit > _HAND_STEPS and not self._alarm:
                self._lose_position()
        elif abs(steps - self._target_steps) <= _STEPS_TOLERANCE:
            self._stand(self._estimator.target)
        elif self._estimator.has_ended(at - _OVERDUE_S):
            self._lose_position()
        else:
            self._estimator.update(at, units)

    def _ask(self) -> protocol.MarlinPosition:
        for line in self._line.request('M114', seconds=_SILENCE_S / 2):
            if position := protocol.parse_position(line):
                return position
        raise DeviceError('M114: the answer has no position')

    def _ask_position(self) -> float:
        """Return the position of the motor, unwrapped units."""
        steps = self._ask().steps[self._units.letter]
        expected = self._estimator.state_at(time.monotonic())[0]
        return self._units.unwrap(steps / self._steps_per_unit, expected)
