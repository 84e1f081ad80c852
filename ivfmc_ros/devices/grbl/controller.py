# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Motion boards with GRBL 1.1: a rotary axis, and lasers on spindle and coolant."""

from dataclasses import replace
import math
import threading

from ivfmc_ros.devices.controller import BoardState
from ivfmc_ros.devices.controller import Limits
from ivfmc_ros.devices.grbl import protocol
from ivfmc_ros.devices.grbl.command_channel import Conversation
from ivfmc_ros.devices.grbl.monitor import CONNECTING
from ivfmc_ros.devices.grbl.monitor import GrblMonitor
from ivfmc_ros.devices.grbl.settings import GrblSettings
from ivfmc_ros.devices.grbl.settings import OUTPUTS
from ivfmc_ros.devices.motion import ramp
from ivfmc_ros.devices.motion.axis_units import AxisUnits
from ivfmc_ros.devices.serial_line import SerialLine
from ivfmc_ros.errors import BoardAlarmError
from ivfmc_ros.errors import BoardLostError
from ivfmc_ros.errors import BoardRefusedError
from ivfmc_ros.errors import DeviceError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.errors import StoppedError
from ivfmc_ros.validation import require_in_range

_MAX_SPINDLE, _HOMING, _MAX_RATE, _ACCELERATION = 30, 22, 110, 120  # numbers of settings
_BOOT = 4.0  # seconds; a boot loader listens for two before it starts the board
_NO_RESET = 2.5  # seconds; after them, opening the port has not reset the board
_BRAKING = 3.0  # seconds, beyond what the acceleration says
_SAME = 1e-3  # of an acceleration; the board has three decimals


class GrblBoard:
    """A MotionBoard with GRBL 1.1."""

    def __init__(self, settings: GrblSettings) -> None:
        self._settings = settings
        self._units = AxisUnits(settings.axis, settings.units_per_turn)
        self._line = SerialLine(on_line=self._hear, on_tick=self._tick, on_lost=self._lose)
        self._talk = Conversation(self._line.write, self._is_busy)
        self._monitor = GrblMonitor(self._units, dict(settings.lasers))
        self._commanding = threading.RLock()
        self._stopping = threading.Lock()

    # -- MotionBoard

    def open(self) -> None:
        """:raises BoardLostError: there is no board, or it does not answer."""
        with self._commanding:
            self._monitor.connected()
            self._line.open(self._settings.port, self._settings.baud)
            try:
                self._await_start()
                self._read_settings()
                if self._monitor.alarm == CONNECTING:
                    self._prepare()
                    self._monitor.cleared()
            except DeviceError:
                self._line.close()
                self._monitor.lose()
                raise

    def close(self) -> None:
        """Turn the lasers off, stop, and disconnect."""
        try:
            if self._monitor.lost:
                # it may still hear, though nobody hears it
                self._line.write(protocol.RESET)
            else:
                self.stop()
        except DeviceError as error:
            # there is nothing else that could be sent
            self._lose(str(error))
        self._talk.fail(StoppedError('the board was closed'))
        self._line.close()

    def home(self) -> None:
        """:raises BoardRefusedError: homing is not enabled ($22=0)."""
        with self._commanding:
            if not self._monitor.settings.get(_HOMING):
                raise BoardRefusedError(
                    'the board has no home switch, or homing is not enabled ($22=1)'
                )
            if self._monitor.alarm is not None:
                self._reset()
            with self._monitor.homing(self._settings.home_timeout):
                self._talk.send('$H')
            self._monitor.cleared()
            self._monitor.wait_report(_BOOT)
            self._prepare()

    def stop(self) -> None:
        """Brake and turn the lasers off, also while a command waits."""
        with self._stopping:
            if self._monitor.moving:
                self._brake()
            self._reset()
            if self._monitor.alarm is None:
                self._prepare_after_stop()

    def clear_alarm(self) -> None:
        """Take commands again after an alarm or a lost board."""
        self._talk.fail(StoppedError('the alarm was cleared'))
        with self._commanding:
            if self._monitor.lost:
                self._line.close()
                self.open()
            else:
                self._reset()
            if self._monitor.locked:
                self._talk.send('$X')
            self._monitor.cleared()
            self._prepare()

    def move_to(self, position: float, velocity: float, acceleration: float) -> None:
        """Begin a move; one in progress is braked first."""
        _require_motion(position, velocity, acceleration)
        epoch = self._talk.epoch
        with self._commanding:
            self._require_ready()
            if self._monitor.moving:
                self.stop()
                self._require_ready()
                epoch = self._talk.epoch
            self._set_acceleration(acceleration)
            target = self._units.from_radians(position)
            feed = max(60 * self._units.length(velocity), 1.0)
            feed = min(feed, self._monitor.settings[self._axis(_MAX_RATE)])
            start = self._monitor.resting_units
            board_target = self._units.to_board(target)
            text = f'G53G1{self._settings.axis}{board_target:.4f}F{feed:.3f}'
            limit = self._monitor.settings[self._axis(_ACCELERATION)]
            plan = ramp.ramp(start, target, feed / 60, limit, 0.0)
            self._monitor.announce(plan)
            try:
                self._talk.send(text, epoch)
            except DeviceError:
                self._monitor.withdraw()
                raise
            self._monitor.begun()
            # answered when the table stands: ok to a move only says that it is queued
            self._talk.begin('G4P0.01', self._monitor.drained, epoch)

    def set_laser(self, name: str | None) -> int:
        """Turn one laser on and all others off; return when, nanoseconds since the epoch."""
        if name is not None and name not in self._settings.lasers:
            known = ', '.join(self._settings.lasers) or 'none'
            raise ParameterError(f'laser: {name!r} is not wired; there are: {known}')
        epoch = self._talk.epoch
        with self._commanding:
            self._require_ready()
            for laser, output in self._settings.lasers.items():
                if laser != name:
                    self._talk.send(OUTPUTS[output][1], epoch)
            self._monitor.note_lasers({})
            if name is not None:
                self._talk.send(self._on_line(self._settings.lasers[name]), epoch)
                self._monitor.note_lasers({name: True})
            return self._monitor.lasers_ns

    def set_power(self, power: float) -> None:
        """Turn the laser on the spindle on with so much, 0 to 1, from now on."""
        self._settings = replace(self._settings, power=power)

    def poll(self) -> BoardState:
        """Return what is known now, without waiting."""
        return self._monitor.state()

    def limits(self) -> Limits:
        """:raises BoardLostError: the board is not connected, nothing is known of it."""
        self._require_connected()
        settings, unit = self._monitor.settings, self._units.length(1.0)
        if self._axis(_ACCELERATION) not in settings:
            raise BoardLostError('the board is not connected yet')
        return Limits(
            velocity=settings[self._axis(_MAX_RATE)] / 60 / unit,
            acceleration=settings[self._axis(_ACCELERATION)] / unit,
        )

    # -- what the reading thread calls

    def _hear(self, text: str, began: float) -> None:
        said = protocol.parse(text)
        if isinstance(said, protocol.Answer):
            self._talk.answer(said.error)
        elif isinstance(said, protocol.Alarm):
            reason = protocol.ALARMS.get(said.number, 'see the list of alarms of GRBL 1.1')
            self._monitor.alarmed(f'ALARM_{said.number}')
            self._talk.fail(BoardAlarmError(f'the board raised alarm {said.number}: {reason}'))
        elif isinstance(said, protocol.Banner):
            self._restarted()
        else:
            self._monitor.hear(said, began)

    def _restarted(self) -> None:
        if self._monitor.restarted():
            self._talk.fail(StoppedError('the motion was stopped'))
        else:
            self._talk.fail(
                BoardAlarmError('the board restarted by itself, the position is lost; home it')
            )

    def _tick(self) -> None:
        if self._monitor.silent:
            self._lose('the board has become silent')
        elif self._monitor.wants_report():
            try:
                self._line.write(protocol.STATUS)
            except DeviceError as error:
                self._lose(str(error))

    def _lose(self, reason: str) -> None:
        if not self._monitor.lost:
            self._monitor.lose()
            self._talk.fail(BoardLostError(reason))

    def _is_busy(self) -> bool:
        return self._monitor.busy and not self._monitor.lost

    # -- what commands are made of

    def _axis(self, setting: int) -> int:
        return setting + self._units.index

    def _on_line(self, output: str) -> str:
        power = self._settings.power * self._monitor.settings.get(_MAX_SPINDLE, 1000.0)
        return OUTPUTS[output][0].format(power)

    def _require_connected(self) -> None:
        if self._monitor.lost:
            raise BoardLostError('the board is lost; clear the alarm to connect again')

    def _require_ready(self) -> None:
        self._require_connected()
        if self._monitor.alarm is not None:
            raise BoardAlarmError(
                f'the board is locked: {self._monitor.alarm}; home it or clear the alarm'
            )

    def _await_start(self) -> None:
        if not self._monitor.wait_start(_NO_RESET):
            self._monitor.expect_start()
            self._line.write(protocol.RESET)
            self._monitor.wait_start(_BOOT)
        if not self._monitor.wait_report(_BOOT):
            raise BoardLostError(
                f'port {self._settings.port}: no GRBL answers; is it the right port and baud?'
            )

    def _read_settings(self) -> None:
        self._talk.send('$$')
        needed = [self._axis(number) for number in (_MAX_RATE, _ACCELERATION)]
        if not all(self._monitor.settings.get(number, 0.0) > 0 for number in needed):
            self._talk.send('$$')
        missing = [f'${n}' for n in needed if not self._monitor.settings.get(n, 0.0) > 0]
        if missing:
            raise BoardRefusedError(f'the board has no axis {self._settings.axis}: {missing[0]}')

    def _prepare(self) -> None:
        """Undo what a reset does to the modes; G1 because a laser board is dark in G0."""
        self._talk.send('G21G90G94')
        self._talk.send('G1F100')
        for output in self._settings.lasers.values():
            self._talk.send(OUTPUTS[output][1])
        self._monitor.note_lasers({})

    def _prepare_after_stop(self) -> None:
        self._talk.send('G21G90G94')
        self._talk.send('G1F100')

    def _brake(self) -> None:
        """Hold the motion; a reset while the table moves would lose the position."""
        limit = self._monitor.settings[self._axis(_ACCELERATION)]
        self._line.write(protocol.HOLD)
        self._monitor.braking(limit)
        rate = self._monitor.settings[self._axis(_MAX_RATE)] / 60
        self._monitor.wait_held(rate / limit + _BRAKING)

    def _reset(self) -> None:
        """Kill spindle, coolant and whatever is queued."""
        for _ in range(2):  # a byte may get lost
            self._monitor.expect_start()
            self._line.write(protocol.RESET)
            if self._monitor.wait_start(_BOOT / 2):
                break
        else:
            raise BoardLostError('the board does not start again after a reset')
        self._monitor.note_lasers({})
        self._monitor.wait_report(_BOOT)

    def _set_acceleration(self, acceleration: float) -> None:
        number = self._axis(_ACCELERATION)
        wanted = round(self._units.length(acceleration), 3)
        if abs(wanted - self._monitor.settings[number]) > _SAME * wanted:
            # kept in the board's EEPROM, which bears 100,000 changes: not sent when it is so
            self._talk.send(f'${number}={wanted:.3f}')
            self._monitor.settings[number] = wanted


def _require_motion(position: float, velocity: float, acceleration: float) -> None:
    if not math.isfinite(position):
        raise ParameterError(f'position: {position} is no angle')
    for name, value in (('velocity', velocity), ('acceleration', acceleration)):
        require_in_range(name, value, 0.0, math.inf, open_low=True, open_high=True)
