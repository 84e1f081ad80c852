# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Common part of emulated controllers that execute one line after the other."""

from collections.abc import Callable
from collections.abc import Mapping
import math

from ivfmc_ros.devices.motion.trajectory import Trajectory
from ivfmc_ros.simulation.emulated_axis import EmulatedAxis
from ivfmc_ros.simulation.laser_outputs import LaserOutputs

# Returns at a time (seconds) whether the line has been executed.
Condition = Callable[[float], bool]


class LineMachine:
    """
    A controller that executes lines in order. Times are steady seconds.

    settings : of the axis, by the numbers of GRBL
    on_motion : called with the time and the trajectory of the table, see EmulatedAxis
    on_outputs : called with the time and the outputs when these change
    clock_scale : controller seconds per second
    """

    CAPACITY = 1024  # bytes of the receive buffer

    def __init__(
        self,
        settings: Mapping[int, float],
        *,
        on_motion: Callable[[float, Trajectory], None],
        on_outputs: Callable[[float, LaserOutputs], None],
        clock_scale: float = 1.0,
    ) -> None:
        self.settings = dict(settings)
        self.axis = EmulatedAxis(self.settings, on_motion, clock_scale)
        self._on_outputs = on_outputs
        self._outputs = self._shown = LaserOutputs()
        self._tx = bytearray()
        self._rx = bytearray()
        self._powered = False
        self._wait: Condition | None = None

    # -- what differs

    def _greet(self, now: float) -> None:
        """Send what the firmware says at its start."""

    def _execute(self, line: str, now: float) -> Condition | None:
        """Execute a line; return a condition that ends it, None if it has ended."""
        raise NotImplementedError

    def _finish(self, now: float) -> None:
        """Send the prompt."""
        raise NotImplementedError

    def _receive(self, byte: int) -> None:
        """Take a byte from the line."""
        if len(self._rx) < self.CAPACITY:
            self._rx.append(byte)

    # -- EmulatedMachine

    def power_on(self, now: float) -> None:
        """Start, or restart; the present position becomes 0."""
        self.axis.kill(now)
        self.axis.reset_origin()
        self._rx.clear()
        self._wait, self._powered = None, True
        self._outputs = LaserOutputs()
        self._greet(now)
        self._show(now)

    def power_off(self, now: float) -> None:
        """Lose the supply: all outputs go off, and the axis stops at once."""
        self.axis.kill(now)
        self._wait, self._powered = None, False
        self._rx.clear()
        self._tx.clear()
        self._outputs = LaserOutputs()
        self._show(now)

    def feed(self, data: bytes, now: float) -> None:
        """Receive bytes."""
        if self._powered:
            self.advance(now)
            for byte in data:
                self._receive(byte)
            self.advance(now)

    def advance(self, now: float) -> None:
        """Do everything that is due until ``now``."""
        while self._powered and (self.axis.advance(now) or self._step(now)):
            pass
        self._show(now)

    def take_output(self) -> bytes:
        """Return the bytes sent since the last call."""
        sent = bytes(self._tx)
        self._tx.clear()
        return sent

    @property
    def next_event(self) -> float:
        """Time at which ``advance`` has something to do, infinite if it waits for bytes."""
        return self.axis.next_event if self._powered else math.inf

    def present_outputs(self) -> LaserOutputs:
        """Return the outputs."""
        return self._outputs

    def _step(self, now: float) -> bool:
        """Execute a line, or a part of it; return whether there may be more to do."""
        if self._wait is not None:
            if not self._wait(now):
                return self.axis.start(now)
            self._wait = None
            self._finish(now)
            return True
        text, found, rest = bytes(self._rx).replace(b'\r', b'\n').partition(b'\n')
        if not found:
            return self.axis.start(now)
        self._rx = bytearray(rest)
        self._wait = self._execute(text.decode('ascii', 'replace'), now)
        if self._wait is None:
            self._finish(now)
        return True

    def _show(self, now: float) -> None:
        if self._outputs != self._shown:
            self._shown = self._outputs
            self._on_outputs(now, self._outputs)

    def _say(self, text: str) -> None:
        self._tx += text.encode('ascii', 'replace')
