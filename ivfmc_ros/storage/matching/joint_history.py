# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Position of a joint over time, interpolated from sensor_msgs/JointState messages.

One history serves messages that arrive late, twice or out of order, and the messages of a bag.
Positions that no table can have are left out: single ones that jump away and back (``strays``).
Where many do, two publishers report the joint, and no position of that time is used.
"""

from bisect import bisect_left
from bisect import bisect_right
from bisect import insort
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
# Reasons why the positions at a time are not used.
CONTRADICTORY = 'table positions contradict each other'
TOO_FAST = 'table faster than 10 rad/s'
GAP = 'table positions missing'

# A position is stray if the table would have to leave and return faster than this acceleration,
# rad/s^2 (turntables reach 10), and further than twice the jitter of a driver that interpolates
# between serial reports, radians.
_MAX_ACCELERATION = 30.0
_MIN_STRAY_LEG = 0.01
# A stray position is left and entered by jumps of about one length.
_MIN_LEG_RATIO = 0.3
# Positions contradict each other where, within this time about a stamp, nanoseconds, at least so
# many are stray, and more than this share.
_FAULT_WINDOW_NS = 1_000_000_000
_MIN_STRAYS = 3
_MAX_STRAY_SHARE = 0.1
# A table does not turn faster than this, rad/s; 10 rad/s are 95 turns a minute. It is too fast
# where all of at least so many messages within a quarter of a second say so.
_MAX_SPEED = 10.0
_SPEED_WINDOW_NS = 250_000_000
_MIN_SPEED_MESSAGES = 5
# The reported velocity is compared with the positions over this time, nanoseconds. It contradicts
# them where it differs by more than half, and by more than the jitter of positions, radians.
_COMPARISON_WINDOW_NS = 300_000_000
_MIN_COMPARED_MESSAGES = 5
_MAX_VELOCITY_ERROR = 0.5
_POSITION_JITTER = 0.02
# No position is interpolated between two messages that are further apart than this, nanoseconds,
# unless the table stands still or the reported velocities, to this share, are those of the motion
# between them: it may have stopped and started meanwhile.
_MAX_GAP_NS = 1_000_000_000
_MAX_GAP_VELOCITY_ERROR = 0.05
# A message whose stamp is this near to an image's stamp, nanoseconds, was sent for the image.
_SAME_STAMP_NS = 1_000_000


class JointHistory:
    """
    Positions of one joint, sorted by stamp and unwrapped: continuous beyond a full turn.

    stamps_ns : stamps of the messages, nanoseconds, ascending
    strays : number of positions that were left out
    """

    def __init__(self) -> None:
        self.stamps_ns: list[int] = []
        self.strays = 0
        self._stray_stamps_ns: list[int] = []
        self._false_velocity: tuple[float, float] | None = None
        self._positions: list[float] = []
        self._velocities: list[float | None] = []

    @classmethod
    def from_messages(cls, messages: Iterable[Any], joint: str, where: str) -> 'JointHistory':
        """
        Collect the positions of a joint from sensor_msgs/JointState messages in any order.

        where : file and topic, for the error
        :raises BagError: no message has the joint, none of its positions is finite, or two
            publishers contradict each other
        """
        history = cls()
        names: set[str] = set()
        publishers: set[str] = set()
        has_position = False
        for message in sorted(messages, key=cdr.stamp_ns):
            names.update(message.name)
            if joint in message.name:
                publishers.add(', '.join(sorted(message.name)))
            has_position |= joint in list(message.name)[: len(message.position)]
            state = joint_in_message(message, joint)
            if state is not None:
                history.add(cdr.stamp_ns(message), *state)
        if not has_position:
            known = ', '.join(sorted(names)) or 'none'
            raise BagError(f'{where}: has no position of joint {joint!r}; joints there: {known}')
        if not history.stamps_ns:
            raise BagError(f'{where}: no position of joint {joint!r} is a finite number')
        if _are_many(history.strays, len(history.stamps_ns)):
            raise BagError(f'{where}: {_two_publishers(history, joint, publishers)}')
        return history

    def add(self, stamp_ns: int, position: float, velocity: float | None = None) -> bool:
        """
        Add a position; a second one of the same stamp is ignored, and so are stray ones.

        stamp_ns : nanoseconds
        position, velocity : radians and radians per second; None for an unknown velocity
        :returns: False where the clock was set back, which deletes all earlier messages
        """
        is_monotonic = not self.stamps_ns or stamp_ns > self.stamps_ns[-1] - CLOCK_JUMP_NS
        if not is_monotonic:
            self.stamps_ns, self._positions, self._velocities = [], [], []
            self._stray_stamps_ns = []
        index = bisect_left(self.stamps_ns, stamp_ns)
        if index < len(self.stamps_ns) and self.stamps_ns[index] == stamp_ns:
            other = self._positions[index]
            if abs(math.remainder(position - other, _TURN)) > _MIN_STRAY_LEG:
                self._count_stray(stamp_ns)
            return is_monotonic
        if self.stamps_ns:
            neighbor = self._positions[max(index - 1, 0)]
            position += _TURN * round((neighbor - position) / _TURN)
        self.stamps_ns.insert(index, stamp_ns)
        self._positions.insert(index, position)
        self._velocities.insert(index, velocity)
        for middle in (index + 1, index, index - 1):
            self._leave_out_stray(middle)
        return is_monotonic

    def _leave_out_stray(self, index: int) -> None:
        """Remove a position to which the table would have to jump and come back."""
        if not 0 < index < len(self.stamps_ns) - 1:
            return
        before, after = self._leg(index), self._leg(index + 1)
        if before[0] * after[0] >= 0.0 or any(abs(leg) <= limit for leg, limit in (before, after)):
            return
        # the position before a jump is not one: the table comes to it slowly
        shorter, longer = sorted((abs(before[0]), abs(after[0])))
        if shorter < _MIN_LEG_RATIO * longer:
            return
        self._count_stray(self.stamps_ns[index])
        del self.stamps_ns[index], self._positions[index], self._velocities[index]
        # the position after it was unwrapped by the stray one
        jump = self._positions[index] - self._positions[index - 1]
        turns = _TURN * round(jump / _TURN)
        if turns:
            self._positions[index:] = [position - turns for position in self._positions[index:]]

    def _leg(self, index: int) -> tuple[float, float]:
        """Return the motion from a message's predecessor, and the greatest plausible one, rad."""
        seconds = (self.stamps_ns[index] - self.stamps_ns[index - 1]) / cdr.NANOSECONDS
        limit = _MIN_STRAY_LEG + 0.5 * _MAX_ACCELERATION * seconds**2
        return self._positions[index] - self._positions[index - 1], limit

    def _count_stray(self, stamp_ns: int) -> None:
        self.strays += 1
        insort(self._stray_stamps_ns, stamp_ns)

    @property
    def confirmed_ns(self) -> int:
        """Stamp of the newest position that cannot turn out to be stray; there must be one."""
        if len(self.stamps_ns) < 3:
            return self.stamps_ns[-1]
        leg, limit = self._leg(len(self.stamps_ns) - 1)
        return self.stamps_ns[-1] if abs(leg) <= limit else self.stamps_ns[-2]

    def fault_at(self, stamp_ns: int) -> str:
        """Return why no position at a stamp can be right, ``CONTRADICTORY`` or so; '' if none."""
        window = stamp_ns - _FAULT_WINDOW_NS, stamp_ns + _FAULT_WINDOW_NS
        strays = _count_between(self._stray_stamps_ns, *window)
        if strays and _are_many(strays, _count_between(self.stamps_ns, *window)):
            return CONTRADICTORY
        if self._is_in_gap(stamp_ns):
            return GAP
        begin = bisect_left(self.stamps_ns, stamp_ns - _SPEED_WINDOW_NS // 2)
        end = bisect_right(self.stamps_ns, stamp_ns + _SPEED_WINDOW_NS // 2)
        if end - begin < _MIN_SPEED_MESSAGES:
            return ''
        legs = zip(
            pairwise(self._positions[begin:end]), pairwise(self.stamps_ns[begin:end]), strict=True
        )
        is_fast = all(
            abs(b - a) * cdr.NANOSECONDS > _MAX_SPEED * (until - since)
            for (a, b), (since, until) in legs
        )
        return TOO_FAST if is_fast else ''

    def _is_in_gap(self, stamp_ns: int) -> bool:
        """Tell whether a stamp is in a pause of the messages, and the motion in it is unknown."""
        after = bisect_left(self.stamps_ns, stamp_ns)
        if not 0 < after < len(self.stamps_ns):
            return False
        since, until = self.stamps_ns[after - 1], self.stamps_ns[after]
        is_near = min(stamp_ns - since, until - stamp_ns) <= EXTRAPOLATION_NS
        moved = self._positions[after] - self._positions[after - 1]
        if until - since <= _MAX_GAP_NS or is_near or abs(moved) <= _MIN_STRAY_LEG:
            return False
        mean = moved * cdr.NANOSECONDS / (until - since)
        ends = self._velocities[after - 1], self._velocities[after]
        limit = _MAX_GAP_VELOCITY_ERROR * abs(mean)
        return any(end is None or abs(end - mean) > limit for end in ends)

    def remarks(self, joint: str) -> tuple[str, ...]:
        """Return what was left out, for a person."""
        found = []
        if self.strays:
            found.append(
                f'{self.strays} positions of joint {joint!r} jump away and back, and are left out'
            )
        if self._false_velocity is not None:
            reported, measured = self._false_velocity
            found.append(
                f'the velocity of joint {joint!r} contradicts its positions (reported '
                f'{reported:.3f}, by positions {measured:.3f} rad/s), and is not used'
            )
        return tuple(found)

    def delete_older_than(self, seconds: float) -> None:
        """Delete messages that are older than the newest one by more than ``seconds``."""
        old = count_older(self.stamps_ns, seconds)
        if old > DELETE_COUNT:
            del self.stamps_ns[:old], self._positions[:old], self._velocities[:old]
            first = bisect_left(self._stray_stamps_ns, self.stamps_ns[0])
            del self._stray_stamps_ns[:first]

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
        """
        Return the velocity, rad/s, as reported.

        Where it is not reported or contradicts the positions, it is the mean over the last 0.1 s.
        """
        after = min(bisect_left(self.stamps_ns, stamp_ns), len(self.stamps_ns) - 1)
        before = after if self.stamps_ns[after] <= stamp_ns else max(after - 1, 0)
        a, b = self._velocities[before], self._velocities[after]
        if a is not None and b is not None and not self._is_false(after):
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

    def _is_false(self, index: int) -> bool:
        """Tell whether the velocities reported up to a message contradict the positions."""
        stamps = self.stamps_ns
        begin = bisect_left(stamps, stamps[index] - _COMPARISON_WINDOW_NS)
        velocities = self._velocities[begin : index + 1]
        if len(velocities) < _MIN_COMPARED_MESSAGES or None in velocities:
            return False
        moved = self._positions[index] - self._positions[begin]
        known = [velocity for velocity in velocities if velocity is not None]
        reported = sum(
            0.5 * (a + b) * (until - since) / cdr.NANOSECONDS
            for (a, b), (since, until) in zip(
                pairwise(known), pairwise(stamps[begin : index + 1]), strict=True
            )
        )
        greater = max(abs(moved), abs(reported))
        if abs(moved - reported) <= _POSITION_JITTER + _MAX_VELOCITY_ERROR * greater:
            return False
        seconds = (stamps[index] - stamps[begin]) / cdr.NANOSECONDS
        self._false_velocity = reported / seconds, moved / seconds
        return True

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


def _count_between(stamps_ns: Sequence[int], begin_ns: int, end_ns: int) -> int:
    return bisect_right(stamps_ns, end_ns) - bisect_left(stamps_ns, begin_ns)


def _are_many(strays: int, others: int) -> bool:
    """Tell whether so many positions are stray that it is not known which ones are right."""
    return strays >= _MIN_STRAYS and strays > _MAX_STRAY_SHARE * (strays + others)


def _two_publishers(history: JointHistory, joint: str, publishers: set[str]) -> str:
    joints = (
        '' if len(publishers) < 2 else f' (messages with {" and with ".join(sorted(publishers))})'
    )
    return (
        f'{history.strays} of {history.strays + len(history.stamps_ns)} positions of joint '
        f'{joint!r} contradict each other: two publishers report it{joints}; record one of them'
    )


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
