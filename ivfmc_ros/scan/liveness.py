# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Detects lost nodes by the time since their last heartbeat in which the receiver was on time."""

from collections.abc import Callable
from collections.abc import Iterable
import time

from ivfmc_ros.errors import HelperError
from ivfmc_ros.errors import ParameterError


class AttentiveClock:
    """
    Counts the seconds in which its owner was on time.

    A process that was stopped, or starved by others, finds the messages of that time still in its
    queues: it has not waited for them, so that this time counts towards no time-out.

    clock : returns steady seconds
    period_s : seconds between two calls of ``tick`` by a timer of the owner
    """

    # A tick may be late by this many periods; the time beyond is not counted.
    _MAX_LATE = 1.0

    def __init__(self, period_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._most_s = period_s * (1.0 + self._MAX_LATE)
        self._counted_s = 0.0
        self._ticked_s = clock()

    def tick(self) -> None:
        """Note that the timer of the owner has called."""
        now_s = self._clock()
        self._counted_s += min(now_s - self._ticked_s, self._most_s)
        self._ticked_s = now_s

    def __call__(self) -> float:
        """Return the seconds counted so far; never more than two periods since the last tick."""
        return self._counted_s + min(self._clock() - self._ticked_s, self._most_s)


class LivenessMonitor:
    """
    Ages of the last heartbeat, or joint state, of every node of a cell.

    Ages are measured on the receiver's clock, never by message stamps: the clocks of the machines
    of a cell differ, and simulated time can stand still. Time in which the receiver itself was
    late is not counted (see ``AttentiveClock``).
    """

    def __init__(self, timeout_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        """
        Start without heartbeats: every node is lost until its first one.

        timeout_s : seconds without a heartbeat after which a node is lost
        clock : returns the seconds of the receiver, an AttentiveClock in a node
        :raises ParameterError: the timeout is not a positive number
        """
        if not timeout_s > 0.0:
            raise ParameterError(f'limit: {timeout_s} s is not a positive time')
        self.timeout_s = timeout_s
        self._clock = clock
        self._last_heartbeat_s: dict[str, float] = {}
        # why a node ended, by its name
        self._ends: dict[str, str] = {}

    def heartbeat(self, name: str) -> None:
        """Store the time of a heartbeat, or of another proof of life, of the node ``name``."""
        self._last_heartbeat_s[name] = self._clock()
        self._ends.pop(name, None)

    def end(self, name: str, reason: str) -> None:
        """Store that a node was seen to end: it is lost at once, until its next heartbeat."""
        self._last_heartbeat_s.pop(name, None)
        self._ends[name] = reason

    def age_s(self, name: str) -> float:
        """Return the seconds since the last heartbeat of a node; infinity without one."""
        last = self._last_heartbeat_s.get(name)
        return float('inf') if last is None else self._clock() - last

    def lost(self, names: Iterable[str]) -> list[str]:
        """Return those of ``names`` whose last heartbeat is older than the timeout."""
        return [name for name in names if self.age_s(name) > self.timeout_s]

    def require_alive(self, names: Iterable[str]) -> None:
        """:raises HelperError: a node is lost; the code names the first one, as CAMERA_LOST."""
        lost = self.lost(names)
        if not lost:
            return
        code = f'{lost[0].upper()}_LOST'
        if lost[0] in self._ends:
            raise HelperError(code, self._ends[lost[0]])
        ages = ', '.join(f'{name} ({_age_text(self.age_s(name))})' for name in lost)
        raise HelperError(code, f'no heartbeat or message from {ages}; check that it runs')


def _age_text(age_s: float) -> str:
    return 'none received' if age_s == float('inf') else f'last {age_s:.1f} s ago'
