# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Protocol of a motion controller: a device that turns the table and switches the lasers.

Each family of controllers has a sub-package of its own (``devices/grbl``) with one class that
implements ``MotionController``. ``TurntableDriver`` and the node know the protocol only.
"""

from collections.abc import Collection
from collections.abc import Mapping
from dataclasses import dataclass
import math
from typing import Protocol

import serial

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.validation import require_in_range

# Values of ControllerState.alarm that every family uses; others are the family's own.
CONTROLLER_LOST = 'CONTROLLER_LOST'  # not connected, or the connection was lost
CONNECTING = 'CONNECTING'  # the port is open, the controller has not started yet
POSITION_LOST = 'POSITION_LOST'  # the controller restarted, or stopped short of its target

NOT_CONNECTED = 'the controller is not connected; call clear_alarm to connect again'


def fault_code(alarm: str | None) -> str:
    """Return the code of ``ivfmc_ros.codes`` for an alarm; '' for none, and while connecting."""
    if alarm is None or alarm == CONNECTING:
        return ''
    return alarm if alarm in (CONTROLLER_LOST, POSITION_LOST) else 'CONTROLLER_ALARM'


def require_motion(position: float, velocity: float, acceleration: float) -> None:
    """
    Refuse a move that is no number, or has no speed.

    :raises ParameterError: a number is not finite, or not positive
    """
    if not math.isfinite(position):
        raise ParameterError(f'position: {position} must be finite')
    for name, value in (('velocity', velocity), ('acceleration', acceleration)):
        require_in_range(name, value, 0.0, math.inf, open_low=True, open_high=True)


def require_laser(name: str | None, lasers: Collection[str]) -> None:
    """
    Refuse a laser that there is not; None is none of them.

    :raises ParameterError: there is no such laser
    """
    if name is not None and name not in lasers:
        known = ', '.join(lasers) or 'none'
        raise ParameterError(f'laser: there is no {name!r}; the lasers are: {known}')


@dataclass(frozen=True, kw_only=True)
class ControllerState:
    """
    State of a controller at the time ``stamp_ns``.

    stamp_ns : nanoseconds since the epoch
    position, velocity : radians (unwrapped) and radians per second, estimated from the
        commanded trajectory and the reports; counter-clockwise about +z is positive
    reported : radians, the position that the controller reported last, at ``reported_ns``
    moving : whether a motion is in progress
    alarm : why the controller accepts no commands (such as POSITION_LOST), None if it does
    lasers : whether each laser is on, by name
    lasers_ns : when the controller acknowledged the last change of a laser, nanoseconds since
        the epoch; 0 while it has acknowledged none
    homed : the position is that of the home switch, or was accepted by the operator
    firmware : name and version of the controller's firmware, '' while it is not connected
    index_mark : what an index mark of the table told, '' without one
    """

    stamp_ns: int
    position: float
    velocity: float
    reported: float
    reported_ns: int
    moving: bool
    alarm: str | None
    lasers: Mapping[str, bool]
    lasers_ns: int
    homed: bool = False
    firmware: str = ''
    index_mark: str = ''

    @property
    def active_laser(self) -> str | None:
        """The name of the laser that is on; '' if several are, None if none is."""
        on = [name for name, is_on in self.lasers.items() if is_on]
        return None if not on else on[0] if len(on) == 1 else ''


@dataclass(frozen=True, kw_only=True)
class AxisLimits:
    """Greatest velocity and acceleration of the axis, rad/s and rad/s^2."""

    velocity: float
    acceleration: float


@dataclass(frozen=True, kw_only=True)
class OffLine:
    """
    How another process turns the outputs of a controller off, and stops its motion.

    handle : file descriptor of the open port, which the other process inherits
    steps : bytes to send, each with the seconds to wait afterwards
    """

    handle: int
    steps: tuple[tuple[bytes, float], ...]


class MotionController(Protocol):
    """
    A rotary axis and its lasers.

    All methods but ``poll`` block until the controller has answered, may be called from any
    thread, and raise DeviceError.
    """

    def open(self) -> None:
        """
        Connect, wait until the controller has started, turn the lasers off.

        :raises ControllerLostError: the port cannot be opened, or the controller does not answer
        """

    def close(self) -> None:
        """Turn the lasers off, stop, and disconnect; raises nothing."""

    def home(self) -> None:
        """
        Search the home switch, which defines position 0; return when the axis is there.

        :raises ControllerRefusedError: there is no home switch, or homing is not enabled
        """

    def stop(self) -> None:
        """Brake and turn the lasers off; a command that waits for an answer is aborted."""

    def clear_alarm(self) -> None:
        """Unlock after an alarm, or connect again; the position may be wrong afterwards."""

    def move_to(self, position: float, velocity: float, acceleration: float) -> None:
        """
        Begin a move that ends in standstill; return when the controller has accepted it.

        A move in progress is replaced: the table brakes first, then it goes to ``position``.

        position : radians, unwrapped
        velocity, acceleration : positive, rad/s, rad/s^2
        :raises ControllerAlarmError: the controller is locked
        """

    def set_laser(self, name: str | None) -> int:
        """
        Turn one laser on and all others off; None turns all off.

        A controller that switches outputs only at standstill answers when the motion has ended.

        :returns: time of the acknowledgement, nanoseconds since the epoch
        """

    def set_power(self, power: float) -> None:
        """Set the power of lasers that can be dimmed, 0 to 1; applies to the next turning on."""

    def poll(self) -> ControllerState:
        """Return the last known state without waiting."""

    def unknown_lines(self) -> Mapping[str, int]:
        """Return how many lines of each kind the driver did not understand."""

    def limits(self) -> AxisLimits:
        """
        Return the limits of the axis.

        :raises ControllerLostError: the controller is not connected, its limits are unknown
        """

    def off_line(self) -> OffLine | None:
        """Return how another process can turn the outputs off; None while not connected."""


class SerialController(MotionController, Protocol):
    """A MotionController on a serial port."""

    def adopt(self, port: serial.Serial, received: bytes) -> None:
        """
        Use an open port for the next connection instead of opening it.

        received : what was received from it already
        """
