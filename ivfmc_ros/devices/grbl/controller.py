# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Motion controller of the GRBL family: a rotary axis, and lasers on its outputs.

GRBL 0.9 and 1.1, grblHAL, FluidNC, Horus (``dialects``). Facts that shape this class
(github.com/gnea/grbl, doc/markdown): ``ok`` to a move means queued, not arrived; M3, M5, M8 and M9
wait until all queued motion has ended; a soft reset while the axis moves loses the position, so a
stop is a feed hold (``!``), then a soft reset (0x18).
"""

from collections.abc import Mapping
import contextlib
from dataclasses import replace
import threading
import time

import serial

from ivfmc_ros.devices.controller import AxisLimits
from ivfmc_ros.devices.controller import CONNECTING
from ivfmc_ros.devices.controller import ControllerState
from ivfmc_ros.devices.controller import NOT_CONNECTED
from ivfmc_ros.devices.controller import OffLine
from ivfmc_ros.devices.controller import require_laser
from ivfmc_ros.devices.controller import require_motion
from ivfmc_ros.devices.grbl import protocol
from ivfmc_ros.devices.grbl.axis_settings import AxisSettings
from ivfmc_ros.devices.grbl.command_channel import CommandChannel
from ivfmc_ros.devices.grbl.dialects import HOMING
from ivfmc_ros.devices.grbl.dialects import MAX_SPINDLE
from ivfmc_ros.devices.grbl.handshake import Handshake
from ivfmc_ros.devices.grbl.handshake import START_TIMEOUT
from ivfmc_ros.devices.grbl.monitor import GrblMonitor
from ivfmc_ros.devices.motion import trajectory
from ivfmc_ros.devices.motion.axis_units import AUTO_AXIS
from ivfmc_ros.devices.motion.axis_units import AxisUnits
from ivfmc_ros.devices.serial_line import SerialLine
from ivfmc_ros.devices.settings import ControllerSettings
from ivfmc_ros.devices.unknown_lines import UnknownLines
from ivfmc_ros.errors import ControllerAlarmError
from ivfmc_ros.errors import ControllerLostError
from ivfmc_ros.errors import ControllerRefusedError
from ivfmc_ros.errors import DeviceError
from ivfmc_ros.errors import StoppedError

_DEFAULT_MAX_SPINDLE = 1000.0  # GRBL's default of $30
_RESET_TIMEOUT = 2.0  # seconds from a soft reset to the banner; no boot loader runs then
_BRAKING_MARGIN = 3.0  # seconds beyond the braking time, for the report of the standstill
_MIN_FEED = 1.0  # controller units per minute; GRBL refuses 0
_ABORT_ALARM = 'ALARM_3'  # of a reset in a motion, or in a hold
_STANDSTILL_PERIOD = 0.01  # seconds between looks whether a motion has ended


# A feed hold, then a reset, which turns the outputs off; twice, because a byte may be lost.
# Seconds in between: the table brakes, but the beam is on.
_OFF_STEPS = ((protocol.HOLD, 0.1), (protocol.RESET, 0.02), (protocol.RESET, 0.0))


class GrblController:
    """A MotionController that runs firmware of the GRBL family; see there for its methods."""

    def __init__(self, settings: ControllerSettings) -> None:
        self._settings = settings
        axis = 'X' if settings.axis == AUTO_AXIS else settings.axis
        self._units = AxisUnits(axis, settings.units_per_turn)
        self._unknown_lines = UnknownLines()
        self._line = SerialLine(
            on_line=self._handle_line, on_tick=self._query_status, on_lost=self._set_lost
        )
        self._channel = CommandChannel(self._line.write, self._is_busy)
        self._monitor = GrblMonitor(self._units, dict(settings.lasers), settings.index_pin)
        self._command_lock = threading.RLock()
        self._stop_lock = threading.Lock()
        self._handshake = Handshake(
            settings, self._line, self._channel, self._monitor, self._units
        )
        self._axis = AxisSettings(self._units, self._channel, self._monitor, self._handshake)

    # -- MotionController

    def open(self) -> None:
        """
        Connect, wait until the controller has started, turn the lasers off.

        :raises ControllerLostError: the port cannot be opened, or GRBL does not answer
        :raises ControllerRefusedError: the controller does not have the axis, or an output
        """
        with self._command_lock:
            self._monitor.begin_connection()
            self._handshake.begin()
            try:
                self._line.open(self._settings.port, self._settings.baud)
                self._handshake.run()
                if self._monitor.alarm == CONNECTING:
                    self._restore_modes_and_outputs()
                    self._monitor.clear_alarm()
            except BaseException:
                # connected or lost, nothing between: clear_alarm connects a lost controller again
                self._line.close()
                self._monitor.set_lost()
                raise

    def close(self) -> None:
        """Turn the lasers off, stop, and disconnect."""
        try:
            if self._monitor.lost:
                # it may still receive, though its reports do not arrive
                self._line.write(protocol.RESET)
            else:
                self.stop()
        except DeviceError as error:
            # there is nothing else that could be sent
            self._set_lost(str(error))
        self._channel.abort(StoppedError('the connection to the controller was closed'))
        self._line.close()

    def home(self) -> None:
        """
        Search the home switch; return when the axis stands beside it.

        :raises ControllerRefusedError: homing is not enabled ($22=0)
        """
        with self._command_lock:
            if not self._monitor.settings.get(HOMING):
                raise ControllerRefusedError(
                    'the controller has no home switch, or homing is not enabled; $22=1 enables it'
                )
            if self._monitor.alarm is not None:
                self._reset()
            with self._monitor.homing(self._settings.home_timeout):
                self._channel.send('$H')
            self._monitor.clear_alarm()
            self._monitor.wait_for_position(START_TIMEOUT)
            self._restore_modes_and_outputs()
            self._monitor.homed = True

    def stop(self) -> None:
        """
        Brake and turn the lasers off; a command that waits for a response is aborted.

        :raises ControllerLostError: the controller is lost; a reset is sent all the same
        """
        with self._stop_lock:
            if self._monitor.lost:
                # it may still receive, though its reports do not arrive
                self._line.write(protocol.RESET)
                self._require_connected()
            held = self._monitor.moving and self._brake()
            self._reset()
            if held and self._monitor.dialect.alarm_after_hold:
                self._unlock_standing()
            if self._monitor.alarm is None:
                self._restore_modes()

    def clear_alarm(self) -> None:
        """Unlock after an alarm, or connect again."""
        self._channel.abort(StoppedError('clear_alarm was called'))
        with self._command_lock:
            if self._monitor.lost:
                self._line.close()
                self.open()
            else:
                self._reset()
            if self._monitor.locked:
                self._channel.send('$X')
            self._monitor.clear_alarm()
            self._restore_modes_and_outputs()
            self._monitor.homed = True  # the operator accepts the position

    def move_to(self, position: float, velocity: float, acceleration: float) -> None:
        """
        Begin a move; a move in progress is braked first.

        :raises ParameterError: a number is not finite, or not positive
        :raises ControllerAlarmError: the controller is locked
        """
        require_motion(position, velocity, acceleration)
        epoch = self._channel.epoch
        with self._command_lock:
            self._require_ready()
            if self._monitor.moving:
                self.stop()
                self._require_ready()
                epoch = self._channel.epoch
            self._axis.set_acceleration(acceleration)
            target = self._units.from_radians(position)
            dialect = self._monitor.dialect
            rate = max(60 * self._units.length(velocity), _MIN_FEED)
            rate = min(rate, self._axis.rate)
            start = self._monitor.target_units
            text = dialect.move.format(
                axis=self._units.letter,
                position=self._units.to_controller(target),
                feed=rate * dialect.feed_seconds / 60,
            )
            limit = self._axis.acceleration
            plan = trajectory.trapezoid(start, target, rate / 60, limit, 0.0)
            self._monitor.announce_move(plan)
            try:
                self._channel.send(text, epoch, self._monitor.begin_move)
            except DeviceError:
                self._monitor.withdraw_move()
                raise
            if dialect.drain:
                self._channel.send_without_waiting(dialect.drain, self._monitor.end_move, epoch)

    def set_laser(self, name: str | None) -> int:
        """
        Turn one laser on and all others off, at the end of a motion; None turns all off.

        :returns: time of the acknowledgment, nanoseconds since the epoch
        :raises ParameterError: there is no such laser
        """
        require_laser(name, self._settings.lasers)
        epoch = self._channel.epoch
        self._wait_for_standstill(epoch)
        with self._command_lock:
            self._require_ready()
            for laser, output in self._settings.lasers.items():
                if laser != name:
                    self._channel.send(self._monitor.dialect.outputs[output][1], epoch)
            self._monitor.set_lasers({})
            if name is not None:
                self._channel.send(self._turn_on_command(self._settings.lasers[name]), epoch)
                self._monitor.set_lasers({name: True})
            return self._monitor.lasers_ns

    def set_power(self, power: float) -> None:
        """Set the power of the laser on the spindle, 0 to 1, for the next turning on."""
        self._settings = replace(self._settings, power=power)

    def poll(self) -> ControllerState:
        """Return the last known state without waiting."""
        return self._monitor.state()

    def unknown_lines(self) -> Mapping[str, int]:
        """Return how many lines of each kind were not understood."""
        return self._unknown_lines.counts()

    def adopt(self, port: serial.Serial, received: bytes) -> None:
        """Use an open port, from which bytes were received, for the next ``open``."""
        self._line.adopt(port, received)

    def off_line(self) -> OffLine | None:
        """Return how another process can turn the outputs off; None while not connected."""
        handle = self._line.handle
        return None if handle is None else OffLine(handle=handle, steps=_OFF_STEPS)

    def limits(self) -> AxisLimits:
        """
        Return the limits that GRBL's settings state.

        :raises ControllerLostError: the controller is not connected
        """
        self._require_connected()
        return self._axis.limits()

    # -- called by the reading thread

    def _handle_line(self, text: str, received_at: float) -> None:
        line = protocol.parse(text)
        self._handshake.note_line(text)
        if line is None:
            self._unknown_lines.add(text)
        if isinstance(line, protocol.Response):
            self._channel.handle_response(line)
        elif isinstance(line, protocol.Alarm):
            alarm = protocol.name_alarm(line)
            self._monitor.handle_alarm(alarm)
            reason = protocol.describe_alarm(alarm)
            self._channel.abort(ControllerAlarmError(f'the controller raised {reason}'))
        elif isinstance(line, protocol.Banner):
            self._handle_banner(line)
        else:
            self._monitor.handle_line(line, received_at)

    def _handle_banner(self, banner: protocol.Banner) -> None:
        if self._monitor.handle_banner(banner):
            self._channel.abort(StoppedError('the motion was stopped'))
        else:
            self._channel.abort(
                ControllerAlarmError(
                    'the controller restarted by itself, its position is lost; call home'
                )
            )

    def _query_status(self) -> None:
        if self._monitor.is_silent:
            # it may still receive, though its reports do not arrive: a reset turns the lasers off
            with contextlib.suppress(DeviceError):
                self._line.write(protocol.RESET)
            self._set_lost('the controller no longer answers status queries')
        elif self._monitor.query_due():
            try:
                self._line.write(protocol.STATUS)
            except DeviceError as error:
                self._set_lost(str(error))

    def _set_lost(self, reason: str) -> None:
        if not self._monitor.lost:
            self._monitor.set_lost()
            self._channel.abort(ControllerLostError(reason))

    def _is_busy(self) -> bool:
        return self._monitor.is_busy and not self._monitor.lost

    # -- steps of commands

    def _turn_on_command(self, output: str) -> str:
        full_power = self._monitor.settings.get(MAX_SPINDLE, _DEFAULT_MAX_SPINDLE)
        command = self._monitor.dialect.outputs[output][0]
        return command.format(power=self._settings.power * full_power)

    def _require_connected(self) -> None:
        if self._monitor.lost:
            raise ControllerLostError(NOT_CONNECTED)

    def _require_ready(self) -> None:
        self._require_connected()
        if self._monitor.alarm is not None:
            raise ControllerAlarmError(
                f'the controller is locked: {protocol.describe_alarm(self._monitor.alarm)}; call '
                'home or clear_alarm'
            )

    def _restore_modes(self) -> None:
        """Set the modes that a reset changed."""
        for command in self._monitor.dialect.modes:
            self._channel.send(command)
        self._monitor.end_start()

    def _restore_modes_and_outputs(self) -> None:
        self._restore_modes()
        for output in self._settings.lasers.values():
            self._channel.send(self._monitor.dialect.outputs[output][1])
        self._monitor.set_lasers({})

    def _brake(self) -> bool:
        """
        Hold the motion: a reset of a moving table would lose the position.

        :returns: whether the axis stands
        """
        deceleration = self._axis.acceleration
        self._line.write(protocol.HOLD)
        self._monitor.begin_hold(deceleration)
        rate = self._axis.rate / 60
        return self._monitor.wait_for_hold(rate / deceleration + _BRAKING_MARGIN)

    def _unlock_standing(self) -> None:
        """Unlock after the alarm of a reset in a hold: the axis stood, its position is kept."""
        if self._monitor.alarm in (_ABORT_ALARM, 'LOCKED'):
            self._channel.send('$X')
            self._monitor.clear_alarm()
            self._monitor.wait_for_position(START_TIMEOUT)

    def _wait_for_standstill(self, epoch: int) -> None:
        """
        Wait for the end of a motion without holding the lock: a move or a stop goes first.

        An output would be switched at the end of the motion all the same.
        """
        while self._monitor.moving and self._monitor.alarm is None:
            if self._channel.epoch != epoch:
                return  # sending raises the reason of the abort
            time.sleep(_STANDSTILL_PERIOD)

    def _reset(self) -> None:
        """Turn the outputs off and discard queued motion."""
        for _ in range(2):  # the byte may be lost
            self._monitor.expect_start()
            self._line.write(protocol.RESET)
            if self._monitor.wait_for_start(_RESET_TIMEOUT if self._monitor.banner else 0.0):
                break
            if self._monitor.banner is None and not self._monitor.lost:
                # it sends none at all: the next report has to do
                self._monitor.assume_started()
                break
        else:
            error = ControllerLostError('the controller did not start again after a reset')
            self._set_lost(str(error))
            raise error
        self._monitor.set_lasers({})
        self._monitor.wait_for_position(START_TIMEOUT)
