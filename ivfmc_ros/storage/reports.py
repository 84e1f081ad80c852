# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the table and the lasers reported, as it comes in: late, twice, or from another time."""

from bisect import bisect_left
from bisect import bisect_right
from collections.abc import Mapping
from collections.abc import Sequence
from itertools import pairwise
import math
from typing import Any

# Why a picture is not used that shows no stripe, but may be subtracted from those that do.
DARK = 'laser off'

_NANOSECONDS = 1_000_000_000
_TURN = 2.0 * math.pi

# What the table does just before the first and after the last report is guessed this far.
TOLERANCE_NS = 250_000_000
# A stamp so much older than the newest one does not come late: time was set back.
JUMP_NS = 1_000_000_000
# Reports are dropped in portions.
_AT_ONCE = 1000
# Without a reported velocity, it is the way of the last tenth of a second.
_SPEED_NS = 100_000_000
# A report this near to a picture's stamp was made for it.
_SAME_NS = 1_000_000


class TableReports:
    """The reported positions, sorted by their stamps and continuous beyond a turn."""

    def __init__(self) -> None:
        self.stamps: list[int] = []
        self._positions: list[float] = []
        self._velocities: list[float | None] = []

    def add(self, stamp_ns: int, position: float, velocity: float | None) -> bool:
        """Take a report, radians and radians per second; False where the time jumped back."""
        steady = not self.stamps or stamp_ns > self.stamps[-1] - JUMP_NS
        if not steady:
            self.stamps, self._positions, self._velocities = [], [], []
        index = bisect_left(self.stamps, stamp_ns)
        if index < len(self.stamps) and self.stamps[index] == stamp_ns:
            return steady
        if self.stamps:
            near = self._positions[max(index - 1, 0)]
            position += _TURN * round((near - position) / _TURN)
        self.stamps.insert(index, stamp_ns)
        self._positions.insert(index, position)
        self._velocities.insert(index, velocity)
        return steady

    def forget(self, history_s: float) -> None:
        """Drop what no picture can need any more."""
        old = _older(self.stamps, history_s)
        if old > _AT_ONCE:
            del self.stamps[:old], self._positions[:old], self._velocities[:old]

    def covers(self, stamp_ns: int) -> bool:
        """Tell whether the position at a stamp is known."""
        if not self.stamps:
            return False
        return self.stamps[0] - TOLERANCE_NS <= stamp_ns <= self.stamps[-1] + TOLERANCE_NS

    def at(self, stamp_ns: int) -> float:
        """Radians: interpolated, and at the ends continued as it moved there."""
        stamps, positions = self.stamps, self._positions
        if stamp_ns < stamps[0]:
            return 2.0 * positions[0] - self._between(2 * stamps[0] - stamp_ns)
        if stamp_ns > stamps[-1]:
            return 2.0 * positions[-1] - self._between(2 * stamps[-1] - stamp_ns)
        return self._between(stamp_ns)

    def speed(self, stamp_ns: int) -> float:
        """Radians per second: as reported, else from the way of the last tenth of a second."""
        after = min(bisect_left(self.stamps, stamp_ns), len(self.stamps) - 1)
        before = after if self.stamps[after] <= stamp_ns else max(after - 1, 0)
        a, b = self._velocities[before], self._velocities[after]
        if a is not None and b is not None:
            span = self.stamps[after] - self.stamps[before]
            share = (stamp_ns - self.stamps[before]) / span if span else 0.0
            return a + (b - a) * min(max(share, 0.0), 1.0)
        if any(self._is_for_picture(index, stamp_ns) for index in (before, after)):
            return 0.0
        start = max(bisect_right(self.stamps, stamp_ns - _SPEED_NS) - 1, 0)
        span = self.stamps[after] - self.stamps[start]
        way = self._positions[after] - self._positions[start]
        return way * _NANOSECONDS / span if span else 0.0

    def _is_for_picture(self, index: int, stamp_ns: int) -> bool:
        near = self.stamps[max(index - 1, 0) : index + 2]
        alone = all(b - a >= _SPEED_NS // 2 for a, b in pairwise(near))
        return alone and abs(self.stamps[index] - stamp_ns) <= _SAME_NS

    def way(self, begin_ns: int, end_ns: int) -> float:
        """Radians between the extremes of the position in a span of time."""
        inside = slice(bisect_left(self.stamps, begin_ns), bisect_right(self.stamps, end_ns))
        positions = [self._between(begin_ns), self._between(end_ns), *self._positions[inside]]
        return max(positions) - min(positions)

    def _between(self, stamp_ns: int) -> float:
        stamps, positions = self.stamps, self._positions
        after = bisect_left(stamps, stamp_ns)
        if after == 0:
            return positions[0]
        if after == len(stamps):
            return positions[-1]
        if stamps[after] == stamp_ns:
            return positions[after]
        share = (stamp_ns - stamps[after - 1]) / (stamps[after] - stamps[after - 1])
        return positions[after - 1] + (positions[after] - positions[after - 1]) * share


class LaserReports:
    """The reported states of the lasers, sorted by their stamps."""

    def __init__(self, lasers: tuple[str, ...]) -> None:
        self._lasers = lasers
        self.stamps: list[int] = []
        self._states: list[tuple[bool, ...]] = []

    def add(self, stamp_ns: int, states: Mapping[str, float]) -> bool:
        """Take a report, above 0.5 is on; False where the time jumped back."""
        steady = not self.stamps or stamp_ns > self.stamps[-1] - JUMP_NS
        if not steady:
            self.stamps, self._states = [], []
        index = bisect_right(self.stamps, stamp_ns)
        # a laser that is not named is as it was
        before = self._states[index - 1] if index else (False,) * len(self._lasers)
        lit = tuple(
            states[name] > 0.5 if name in states else was
            for name, was in zip(self._lasers, before, strict=True)
        )
        self.stamps.insert(index, stamp_ns)
        self._states.insert(index, lit)
        return steady

    def forget(self, history_s: float) -> None:
        """Drop what no picture can need any more."""
        old = _older(self.stamps, history_s)
        if old > _AT_ONCE:
            # the last of them says how the lasers are
            del self.stamps[: old - 1], self._states[: old - 1]

    def during(self, stamp_ns: int, exposure_ns: int, always_on: bool) -> tuple[int | None, str]:
        """Return the laser that was on during an exposure, or None and why there is none."""
        if always_on:
            return 0, ''
        latest = bisect_right(self.stamps, stamp_ns) - 1
        if latest < 0:
            return None, 'lasers not known'
        end = bisect_right(self.stamps, stamp_ns + exposure_ns)
        if any(state != self._states[latest] for state in self._states[latest + 1 : end]):
            return None, 'laser changed'
        on = [index for index, lit in enumerate(self._states[latest]) if lit]
        if len(on) != 1:
            return None, 'two lasers on' if on else DARK
        return on[0], ''


def _older(stamps: Sequence[int], history_s: float) -> int:
    """Return how many of the sorted stamps are older than the newest by ``history_s``."""
    if not stamps or math.isinf(history_s):
        return 0
    return bisect_left(stamps, stamps[-1] - int(history_s * _NANOSECONDS))


def joint_of(message: Any, joint: str) -> tuple[float, float | None] | None:
    """
    Return position and velocity of a joint in a sensor_msgs/JointState.

    returns : radians and radians per second (None where it is not said); None without the joint,
        or where its position is no number, as before an axis was homed
    """
    names = list(message.name)
    if joint not in names or names.index(joint) >= len(message.position):
        return None
    index = names.index(joint)
    position = float(message.position[index])
    if not math.isfinite(position):
        return None
    velocity = float(message.velocity[index]) if index < len(message.velocity) else math.nan
    return position, velocity if math.isfinite(velocity) else None
