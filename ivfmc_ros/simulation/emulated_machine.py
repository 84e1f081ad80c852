# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Protocol of an emulated motion controller: bytes in, bytes out, at given times."""

from typing import Protocol


class EmulatedMachine(Protocol):
    """
    A controller without a port. Times are steady seconds.

    settings : by the numbers of GRBL
    """

    settings: dict[int, float]

    def power_on(self, now: float) -> None:
        """Start, or restart; the present position becomes 0."""

    def feed(self, data: bytes, now: float) -> None:
        """Receive bytes."""

    def advance(self, now: float) -> None:
        """Do everything that is due until ``now``."""

    def take_output(self) -> bytes:
        """Return the bytes sent since the last call."""

    @property
    def next_event(self) -> float:
        """Time at which ``advance`` has something to do, infinite if it waits for bytes."""

    def power_off(self, now: float) -> None:
        """Lose the supply: all outputs go off, and the axis stops at once."""

    def alarm(self, number: int, now: float) -> None:
        """Raise an alarm, as a limit switch does."""
