# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
On/off states of the lasers over time, from sensor_msgs/JointState messages (position 1.0: on).

One history serves messages that arrive late or out of order, and the messages of a bag.
"""

from bisect import bisect_right
from collections.abc import Iterable
from collections.abc import Mapping
from collections.abc import Sequence
from typing import Any

from ivfmc_ros.errors import BagError
from ivfmc_ros.storage.matching.joint_history import CLOCK_JUMP_NS
from ivfmc_ros.storage.matching.joint_history import count_older
from ivfmc_ros.storage.matching.joint_history import DELETE_COUNT
from ivfmc_ros.storage.messages import cdr

# Why an image shows no stripe; such an image can be a dark frame.
LASER_OFF = 'laser off'

# Positions in laser_states are 0.0 or 1.0.
_ON_THRESHOLD = 0.5


class LaserHistory:
    """
    States of the lasers of a cell, sorted by stamp.

    lasers : names, in the order of the cell
    stamps_ns : stamps of the messages, nanoseconds, ascending
    """

    def __init__(self, lasers: Sequence[str]) -> None:
        self.lasers = tuple(lasers)
        self.stamps_ns: list[int] = []
        self._states: list[tuple[bool, ...]] = []

    @classmethod
    def from_messages(
        cls, messages: Iterable[Any], lasers: Sequence[str], where: str
    ) -> 'LaserHistory':
        """
        Collect the states of the cell's lasers from messages in any order.

        lasers : names, in the order of the cell; others in the messages are ignored
        where : file and topic, for the error
        :raises BagError: no message has a laser of the cell
        """
        history = cls(lasers)
        names: set[str] = set()
        for message in sorted(messages, key=cdr.stamp_ns):
            names.update(message.name)
            states = dict(zip(message.name, message.position, strict=False))
            history.add(cdr.stamp_ns(message), states)
        if not names.intersection(lasers):
            raise BagError(
                f'{where}: names none of the lasers {", ".join(lasers)}; '
                f'lasers there: {", ".join(sorted(names)) or "none"}'
            )
        return history

    def add(self, stamp_ns: int, states: Mapping[str, float]) -> bool:
        """
        Add the states of a message; a laser that it does not name keeps its state.

        stamp_ns : nanoseconds
        states : by name; above 0.5 is on
        :returns: False where the clock was set back, which deletes all earlier messages
        """
        is_monotonic = not self.stamps_ns or stamp_ns > self.stamps_ns[-1] - CLOCK_JUMP_NS
        if not is_monotonic:
            self.stamps_ns, self._states = [], []
        index = bisect_right(self.stamps_ns, stamp_ns)
        previous = self._states[index - 1] if index else (False,) * len(self.lasers)
        on = tuple(
            states[name] > _ON_THRESHOLD if name in states else was_on
            for name, was_on in zip(self.lasers, previous, strict=True)
        )
        self.stamps_ns.insert(index, stamp_ns)
        self._states.insert(index, on)
        return is_monotonic

    def delete_older_than(self, seconds: float) -> None:
        """Delete messages that are older than the newest one by more than ``seconds``."""
        old = count_older(self.stamps_ns, seconds)
        if old > DELETE_COUNT:
            # the last of the old ones holds the state until the first of the others
            del self.stamps_ns[: old - 1], self._states[: old - 1]

    def laser_during(self, stamp_ns: int, exposure_ns: int) -> tuple[int | None, str]:
        """
        Return the laser that was on during an exposure.

        stamp_ns, exposure_ns : start and duration of the exposure
        :returns: index of the laser in the order of the cell, and ''; or None and the reason why
            there is not exactly one
        """
        latest = bisect_right(self.stamps_ns, stamp_ns) - 1
        if latest < 0:
            return None, 'lasers not known'
        end = bisect_right(self.stamps_ns, stamp_ns + exposure_ns)
        if any(state != self._states[latest] for state in self._states[latest + 1 : end]):
            return None, 'laser changed'
        on = [index for index, is_on in enumerate(self._states[latest]) if is_on]
        if len(on) != 1:
            return None, 'two lasers on' if on else LASER_OFF
        return on[0], ''
