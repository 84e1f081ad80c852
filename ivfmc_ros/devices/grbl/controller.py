# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Motion controller with GRBL 1.1: a rotary axis, and lasers on the spindle and coolant outputs.

Facts of GRBL that shape this class (github.com/gnea/grbl, doc/markdown): ``ok`` to a move means
queued, not arrived; M3, M5, M8 and M9 wait until all queued motion has ended; a soft reset while
the axis moves loses the position, so a stop is a feed hold (``!``), then a soft reset (0x18).
"""

import contextlib
from dataclasses import replace
import math
import threading

from ivfmc_ros.devices.controller import AxisLimits
from ivfmc_ros.devices.controller import CONNECTING
from ivfmc_ros.devices.controller import ControllerState
from ivfmc_ros.devices.grbl import protocol
from ivfmc_ros.devices.grbl.command_channel import CommandChannel
from ivfmc_ros.devices.grbl.handshake import ACCELERATION
from ivfmc_ros.devices.grbl.handshake import Handshake
from ivfmc_ros.devices.grbl.handshake import HOMING
from ivfmc_ros.devices.grbl.handshake import MAX_RATE
from ivfmc_ros.devices.grbl.handshake import MAX_SPINDLE
from ivfmc_ros.devices.grbl.handshake import START_TIMEOUT
from ivfmc_ros.devices.grbl.monitor import GrblMonitor
from ivfmc_ros.devices.grbl.settings import GrblSettings
from ivfmc_ros.devices.grbl.settings import OUTPUTS
from ivfmc_ros.devices.motion import trajectory
from ivfmc_ros.devices.motion.axis_units import AxisUnits
from ivfmc_ros.devices.serial_line import SerialLine
from ivfmc_ros.errors import ControllerAlarmError
from ivfmc_ros.errors import ControllerLostError
from ivfmc_ros.errors import ControllerRefusedError
from ivfmc_ros.errors import DeviceError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.errors import StoppedError
from ivfmc_ros.validation import require_in_range

_DEFAULT_MAX_SPINDLE = 1000.0  # GRBL's default of $30
_RESET_TIMEOUT = 2.0  # seconds from a soft reset to the banner; no boot loader runs then
_BRAKING_MARGIN = 3.0  # seconds beyond the braking time, for the report of the standstill
_MIN_FEED = 1.0  # controller units per minute; GRBL refuses 0
_ACCELERATION_TOLERANCE = 1e-3  # relative; GRBL reports settings with three decimals


class GrblController:
    """A MotionController that runs GRBL 1.1; see there for its methods."""

    def __init__(self, settings: GrblSettings) -> None:
        self._settings = settings
        self._units = AxisUnits(settings.axis, settings.units_per_turn)
        self._line = SerialLine(
            on_line=self._handle_line, on_tick=self._query_status, on_lost=self._set_lost
        )
        self._channel = CommandChannel(self._line.write, self._is_busy)
        self._monitor = GrblMonitor(self._units, dict(settings.lasers))
        self._command_lock = threading.RLock()
        self._stop_lock = threading.Lock()
        self._handshake = Handshake(settings, self._line, self._channel, self._monitor)

    # -- MotionController

    def open(self) -> None:
        """
        Connect, wait until the controller has started, turn the lasers off.

        :raises ControllerLostError: the port cannot be opened, or GRBL does not answer
        :raises ControllerRefusedError: GRBL is older than 1.1, or does not have the axis
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
            if self._monitor.moving:
                self._brake()
            self._reset()
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

    def move_to(self, position: float, velocity: float, acceleration: float) -> None:
        """
        Begin a move; a move in progress is braked first.

        :raises ParameterError: a number is not finite, or not positive
        :raises ControllerAlarmError: the controller is locked
        """
        _require_motion(position, velocity, acceleration)
        epoch = self._channel.epoch
        with self._command_lock:
            self._require_ready()
            if self._monitor.moving:
                self.stop()
                self._require_ready()
                epoch = self._channel.epoch
            self._set_acceleration(acceleration)
            target = self._units.from_radians(position)
            feed = max(60 * self._units.length(velocity), _MIN_FEED)
            feed = min(feed, self._axis_setting(MAX_RATE))
            start = self._monitor.target_units
            controller_target = self._units.to_controller(target)
            text = f'G53G1{self._settings.axis}{controller_target:.4f}F{feed:.3f}'
            limit = self._axis_setting(ACCELERATION)
            plan = trajectory.trapezoid(start, target, feed / 60, limit, 0.0)
            self._monitor.announce_move(plan)
            try:
                self._channel.send(text, epoch, self._monitor.begin_move)
            except DeviceError:
                self._monitor.withdraw_move()
                raise
            # a dwell is answered when the motion has ended
            self._channel.send_without_waiting('G4P0.01', self._monitor.end_move, epoch)

    def set_laser(self, name: str | None) -> int:
        """
        Turn one laser on and all others off, at the end of a motion; None turns all off.

        :returns: time of the acknowledgment, nanoseconds since the epoch
        :raises ParameterError: there is no such laser
        """
        if name is not None and name not in self._settings.lasers:
            known = ', '.join(self._settings.lasers) or 'none'
            raise ParameterError(f'laser: there is no {name!r}; the lasers are: {known}')
        epoch = self._channel.epoch
        with self._command_lock:
            self._require_ready()
            for laser, output in self._settings.lasers.items():
                if laser != name:
                    self._channel.send(OUTPUTS[output][1], epoch)
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

    def limits(self) -> AxisLimits:
        """
        Return the limits that GRBL's settings state.

        :raises ControllerLostError: the controller is not connected
        """
        self._require_connected()
        if self._setting_number(ACCELERATION) not in self._monitor.settings:
            raise ControllerLostError('the controller is not connected yet')
        units_per_radian = self._units.length(1.0)
        return AxisLimits(
            velocity=self._axis_setting(MAX_RATE) / 60 / units_per_radian,
            acceleration=self._axis_setting(ACCELERATION) / units_per_radian,
        )

    # -- called by the reading thread

    def _handle_line(self, text: str, received_at: float) -> None:
        line = protocol.parse(text)
        self._handshake.note_line(text)
        if isinstance(line, protocol.Response):
            self._channel.handle_response(line.error)
        elif isinstance(line, protocol.Alarm):
            reason = protocol.ALARMS.get(line.number, 'see the list of alarms of GRBL 1.1')
            self._monitor.handle_alarm(f'ALARM_{line.number}')
            self._channel.abort(
                ControllerAlarmError(f'the controller raised alarm {line.number}: {reason}')
            )
        elif isinstance(line, protocol.Banner):
            self._handle_banner(line.version)
        else:
            self._monitor.handle_line(line, received_at)

    def _handle_banner(self, version: str) -> None:
        if self._monitor.handle_banner(version):
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

    def _setting_number(self, first: int) -> int:
        """Return the number of the axis' setting, ``first`` being that of the X axis."""
        return first + self._units.index

    def _axis_setting(self, first: int) -> float:
        return self._monitor.settings[self._setting_number(first)]

    def _turn_on_command(self, output: str) -> str:
        full_power = self._monitor.settings.get(MAX_SPINDLE, _DEFAULT_MAX_SPINDLE)
        return OUTPUTS[output][0].format(self._settings.power * full_power)

    def _require_connected(self) -> None:
        if self._monitor.lost:
            raise ControllerLostError(
                'the controller is not connected; call clear_alarm to connect again'
            )

    def _require_ready(self) -> None:
        self._require_connected()
        if self._monitor.alarm is not None:
            raise ControllerAlarmError(
                f'the controller is locked: {self._monitor.alarm}; call home or clear_alarm'
            )

    def _restore_modes(self) -> None:
        """Set the modes that a reset changed; G1 because in laser mode G0 turns the laser off."""
        self._channel.send('G21G90G94')
        self._channel.send('G1F100')

    def _restore_modes_and_outputs(self) -> None:
        self._restore_modes()
        for output in self._settings.lasers.values():
            self._channel.send(OUTPUTS[output][1])
        self._monitor.set_lasers({})

    def _brake(self) -> None:
        """Hold the motion: a reset of a moving table would lose the position."""
        deceleration = self._axis_setting(ACCELERATION)
        self._line.write(protocol.HOLD)
        self._monitor.begin_hold(deceleration)
        rate = self._axis_setting(MAX_RATE) / 60
        self._monitor.wait_for_hold(rate / deceleration + _BRAKING_MARGIN)

    def _reset(self) -> None:
        """Turn the outputs off and discard queued motion."""
        for _ in range(2):  # the byte may be lost
            self._monitor.expect_start()
            self._line.write(protocol.RESET)
            if self._monitor.wait_for_start(_RESET_TIMEOUT):
                break
        else:
            error = ControllerLostError('the controller did not start again after a reset')
            self._set_lost(str(error))
            raise error
        self._monitor.set_lasers({})
        self._monitor.wait_for_position(START_TIMEOUT)

    def _set_acceleration(self, acceleration: float) -> None:
        number = self._setting_number(ACCELERATION)
        wanted = round(self._units.length(acceleration), 3)
        if abs(wanted - self._monitor.settings[number]) > _ACCELERATION_TOLERANCE * wanted:
            # written only if it differs: the EEPROM endures 100,000 writes
            self._channel.send(f'${number}={wanted:.3f}')
            self._handshake.read_settings()
            written = self._monitor.settings[number]
            if abs(wanted - written) > _ACCELERATION_TOLERANCE * wanted:
                raise ControllerRefusedError(
                    f'${number}={wanted:.3f}: the controller reads back {written:.3f}; a byte was '
                    'lost on the line, or its firmware limits the acceleration'
                )


def _require_motion(position: float, velocity: float, acceleration: float) -> None:
    if not math.isfinite(position):
        raise ParameterError(f'position: {position} must be finite')
    for name, value in (('velocity', velocity), ('acceleration', acceleration)):
        require_in_range(name, value, 0.0, math.inf, open_low=True, open_high=True)
