# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Position of a joint over time, interpolated from sensor_msgs/JointState messages.

One history serves messages that arrive late, twice or out of order, and the messages of a bag.
"""

from bisect import bisect_left
from bisect import bisect_right
from collections.abc import Iterable
from collections.abc import Sequence
from itertools import pairwise
import math
from typing import Any

from ivfmc_ros.errors import BagError
from ivfmc_ros.storage.messages import cdr

_TURN = 2.0 * math.pi

# Positions are extrapolated this far beyond the first and the last message, nanoseconds; drivers
# report at 4 Hz or faster.
EXTRAPOLATION_NS = 250_000_000
# A stamp that is older than the newest one by this much, nanoseconds, is a clock that was set
# back, not a late message.
CLOCK_JUMP_NS = 1_000_000_000
# Old messages are deleted when so many have collected: deleting at the front costs O(n).
DELETE_COUNT = 1000
# Without a reported velocity it is the mean over this time, nanoseconds.
_VELOCITY_WINDOW_NS = 100_000_000
# A message whose stamp is this near to an image's stamp, nanoseconds, was sent for the image.
_SAME_STAMP_NS = 1_000_000


class JointHistory:
    """
    Positions of one joint, sorted by stamp and unwrapped: continuous beyond a full turn.

    stamps_ns : stamps of the messages, nanoseconds, ascending
    """

    def __init__(self) -> None:
        self.stamps_ns: list[int] = []
        self._positions: list[float] = []
        self._velocities: list[float | None] = []

    @classmethod
    def from_messages(cls, messages: Iterable[Any], joint: str, where: str) -> 'JointHistory':
        """
        Collect the positions of a joint from sensor_msgs/JointState messages in any order.

        where : file and topic, for the error
        :raises BagError: no message has the joint, or none of its positions is finite
        """
        history = cls()
        names: set[str] = set()
        has_position = False
        for message in sorted(messages, key=cdr.stamp_ns):
            names.update(message.name)
            has_position |= joint in list(message.name)[: len(message.position)]
            state = joint_in_message(message, joint)
            if state is not None:
                history.add(cdr.stamp_ns(message), *state)
        if not has_position:
            known = ', '.join(sorted(names)) or 'none'
            raise BagError(f'{where}: has no position of joint {joint!r}; joints there: {known}')
        if not history.stamps_ns:
            raise BagError(f'{where}: no position of joint {joint!r} is a finite number')
        return history

    def add(self, stamp_ns: int, position: float, velocity: float | None = None) -> bool:
        """
        Add a position; a second one of the same stamp is ignored.

        stamp_ns : nanoseconds
        position, velocity : radians and radians per second; None for an unknown velocity
        :returns: False where the clock was set back, which deletes all earlier messages
        """
        is_monotonic = not self.stamps_ns or stamp_ns > self.stamps_ns[-1] - CLOCK_JUMP_NS
        if not is_monotonic:
            self.stamps_ns, self._positions, self._velocities = [], [], []
        index = bisect_left(self.stamps_ns, stamp_ns)
        if index < len(self.stamps_ns) and self.stamps_ns[index] == stamp_ns:
            return is_monotonic
        if self.stamps_ns:
            neighbor = self._positions[max(index - 1, 0)]
            position += _TURN * round((neighbor - position) / _TURN)
        self.stamps_ns.insert(index, stamp_ns)
        self._positions.insert(index, position)
        self._velocities.insert(index, velocity)
        return is_monotonic

    def delete_older_than(self, seconds: float) -> None:
        """Delete messages that are older than the newest one by more than ``seconds``."""
        old = count_older(self.stamps_ns, seconds)
        if old > DELETE_COUNT:
            del self.stamps_ns[:old], self._positions[:old], self._velocities[:old]

    def covers(self, stamp_ns: int) -> bool:
        """Tell whether the position at a stamp is known, by interpolation or extrapolation."""
        if not self.stamps_ns:
            return False
        first, last = self.stamps_ns[0], self.stamps_ns[-1]
        return first - EXTRAPOLATION_NS <= stamp_ns <= last + EXTRAPOLATION_NS

    def position_at(self, stamp_ns: int) -> float:
        """
        Return the position, radians: linear interpolation between messages.

        Before the first and after the last message the motion is mirrored at that message, so a
        constant velocity continues and a standstill stays one.
        """
        stamps, positions = self.stamps_ns, self._positions
        if stamp_ns < stamps[0]:
            return 2.0 * positions[0] - self._interpolate(2 * stamps[0] - stamp_ns)
        if stamp_ns > stamps[-1]:
            return 2.0 * positions[-1] - self._interpolate(2 * stamps[-1] - stamp_ns)
        return self._interpolate(stamp_ns)

    def velocity_at(self, stamp_ns: int) -> float:
        """Return the velocity, rad/s: as reported, else the mean over the last 0.1 s."""
        after = min(bisect_left(self.stamps_ns, stamp_ns), len(self.stamps_ns) - 1)
        before = after if self.stamps_ns[after] <= stamp_ns else max(after - 1, 0)
        a, b = self._velocities[before], self._velocities[after]
        if a is not None and b is not None:
            span = self.stamps_ns[after] - self.stamps_ns[before]
            share = (stamp_ns - self.stamps_ns[before]) / span if span else 0.0
            return a + (b - a) * min(max(share, 0.0), 1.0)
        if any(self._belongs_to_image(index, stamp_ns) for index in (before, after)):
            return 0.0
        start = max(bisect_right(self.stamps_ns, stamp_ns - _VELOCITY_WINDOW_NS) - 1, 0)
        span = self.stamps_ns[after] - self.stamps_ns[start]
        distance = self._positions[after] - self._positions[start]
        return distance * cdr.NANOSECONDS / span if span else 0.0

    def travel(self, begin_ns: int, end_ns: int) -> float:
        """Return the range of the positions in a span of time, radians."""
        inside = slice(bisect_left(self.stamps_ns, begin_ns), bisect_right(self.stamps_ns, end_ns))
        ends = [self._interpolate(begin_ns), self._interpolate(end_ns)]
        positions = [*ends, *self._positions[inside]]
        return max(positions) - min(positions)

    def _belongs_to_image(self, index: int, stamp_ns: int) -> bool:
        """Tell whether a message was sent once for an image: no others within half the window."""
        near = self.stamps_ns[max(index - 1, 0) : index + 2]
        is_single = all(b - a >= _VELOCITY_WINDOW_NS // 2 for a, b in pairwise(near))
        return is_single and abs(self.stamps_ns[index] - stamp_ns) <= _SAME_STAMP_NS

    def _interpolate(self, stamp_ns: int) -> float:
        """Interpolate; the first and the last position hold beyond the ends."""
        stamps, positions = self.stamps_ns, self._positions
        after = bisect_left(stamps, stamp_ns)
        if after == 0:
            return positions[0]
        if after == len(stamps):
            return positions[-1]
        if stamps[after] == stamp_ns:
            return positions[after]
        share = (stamp_ns - stamps[after - 1]) / (stamps[after] - stamps[after - 1])
        return positions[after - 1] + (positions[after] - positions[after - 1]) * share


def count_older(stamps_ns: Sequence[int], seconds: float) -> int:
    """Return how many of the ascending stamps are older than the newest by over ``seconds``."""
    if not stamps_ns or math.isinf(seconds):
        return 0
    return bisect_left(stamps_ns, stamps_ns[-1] - int(seconds * cdr.NANOSECONDS))


def joint_in_message(message: Any, joint: str) -> tuple[float, float | None] | None:
    """
    Return position and velocity of a joint in a sensor_msgs/JointState.

    :returns: radians and radians per second, None for a velocity that is absent or not finite;
        None where the joint is absent or its position is not finite, as before homing
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
