# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a motion board with lasers is to the rest of the scanner."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, kw_only=True)
class BoardState:
    """
    What the board does at ``stamp_ns``.

    position, velocity : radians (unwrapped) and radians per second, of the motion model that
        follows the reports; counter-clockwise about +z is positive
    reported : radians, what the board itself said last, at ``reported_ns``
    moving : not standing at the end of a motion
    alarm : why it does not take commands (such as POSITION_LOST), None when it does
    lasers : by name, whether it is on
    lasers_ns : when the board acknowledged the last change of a laser
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


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What the axis can do: radians per second, radians per second squared."""

    velocity: float
    acceleration: float


class MotionBoard(Protocol):
    """
    A rotary axis and its lasers.

    All but ``poll`` wait for the board, may be called from any thread, and raise DeviceError.
    """

    def open(self) -> None:
        """
        Connect, wait until the board has started, turn the lasers off.

        :raises BoardLostError: there is no board, or it does not answer
        """

    def close(self) -> None:
        """Turn the lasers off, stop, and disconnect; raises nothing."""

    def home(self) -> None:
        """:raises BoardRefusedError: the board has no home switch, or homing is not enabled."""

    def stop(self) -> None:
        """Brake and turn the lasers off, also while a command waits; that one is given up."""

    def clear_alarm(self) -> None:
        """Take commands again after an alarm or a lost board; the position may be wrong."""

    def move_to(self, position: float, velocity: float, acceleration: float) -> None:
        """
        Begin a move that ends in standstill; return when the board has accepted it.

        A move in progress is given up: the table brakes first, then it goes to ``position``.

        position : radians, unwrapped
        velocity, acceleration : positive, radians per second, radians per second squared
        :raises BoardAlarmError: the board is locked
        """

    def set_laser(self, name: str | None) -> int:
        """
        Turn one laser on and all others off; return when, nanoseconds since the epoch.

        None turns all off. A board whose laser lines wait for motion answers at its end.
        """

    def set_power(self, power: float) -> None:
        """Turn lasers whose power can be set on with so much, 0 to 1, from now on."""

    def poll(self) -> BoardState:
        """Return what is known now, without waiting."""

    def limits(self) -> Limits:
        """:raises BoardLostError: the board is not connected, nothing is known of it."""
