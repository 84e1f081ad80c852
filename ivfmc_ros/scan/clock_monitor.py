# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Detects jumps of the clocks of a cell: stamps against the steady clock of the receiver."""

from collections.abc import Callable
import time

from ivfmc_ros.errors import ClockJumpError

# Seconds by which the stamps of one topic may go back: publishers stamp in order, and those of one
# topic that share it differ by less than the period of joint_states.
_BACKWARD_S = 0.03
# Seconds by which a stamp may be ahead of the earliest ones relative to their reception: the
# latency of a loaded computer that becomes idle drops by less.
_FORWARD_S = 0.5
# Seconds after the first message of a topic until its latency is known: the first messages are
# received late, after the discovery of their publisher.
_WARM_UP_S = 1.0
# Seconds per second by which a clock may differ from the steady one: twice the 500 ppm that NTP
# adjusts a clock by.
_DRIFT = 1e-3
# Seconds by which the clock of this computer may change between two checks. It is read within
# microseconds of the steady clock, so that no load makes it differ.
_OWN_JUMP_S = 0.03
# Two readings of the steady clock around one of the wall clock may be this far apart, seconds.
_READING_S = 0.005


class ClockMonitor:
    """
    Jumps of the clocks that stamp messages, and of the one of this computer.

    jump : what jumped and by how much; '' while no clock jumped
    """

    def __init__(
        self,
        steady: Callable[[], float] = time.monotonic,
        wall: Callable[[], float] = time.time,
    ) -> None:
        """``steady`` and ``wall`` return seconds; ``steady`` never jumps."""
        self._steady, self._wall = steady, wall
        self.reset()

    def reset(self) -> None:
        """Forget everything that was received."""
        self.jump = ''
        self._topics: dict[str, _TopicClock] = {}
        self._own_offset_s: float | None = None

    def add(self, topic: str, stamp_ns: int) -> None:
        """Compare the stamp of a message that was received now, nanoseconds."""
        now_s = self._steady()
        known = self._topics.get(topic)
        if known is None:
            self._topics[topic] = _TopicClock(stamp_ns, now_s)
            return
        change_s = known.add(stamp_ns, now_s)
        if change_s:
            self._report(f'the stamps of {topic}', change_s)

    def check_own_clock(self) -> None:
        """Compare the wall clock of this computer with its steady clock."""
        before_s = self._steady()
        offset_s = self._wall() - before_s
        if self._steady() - before_s > _READING_S:
            # interrupted between the two readings
            return
        known_s, self._own_offset_s = self._own_offset_s, offset_s
        if known_s is not None and abs(offset_s - known_s) > _OWN_JUMP_S:
            self._report('the clock of this computer', offset_s - known_s)

    def require_no_jump(self) -> None:
        """:raises ClockJumpError: a clock has jumped since the last ``reset``."""
        if self.jump:
            raise ClockJumpError(self.jump)

    def _report(self, what: str, change_s: float) -> None:
        direction = 'forward' if change_s > 0.0 else 'back'
        self.jump = self.jump or (
            f'{what} jumped {direction} by {abs(change_s):.2f} s during the scan: the table '
            'angles of the images are not known; set the clocks before a scan'
        )


class _TopicClock:
    """Stamps of one topic: the newest one, and the least latency of the messages."""

    def __init__(self, stamp_ns: int, now_s: float) -> None:
        self._first_s = self._last_s = now_s
        self._stamp_ns = stamp_ns
        # stamp minus time of reception, of the message with the least latency
        self._ahead_s = stamp_ns * 1e-9 - now_s

    def add(self, stamp_ns: int, now_s: float) -> float:
        """Return the seconds by which the clock jumped; 0.0 where it did not."""
        back_s = (self._stamp_ns - stamp_ns) * 1e-9
        ahead_s = stamp_ns * 1e-9 - now_s
        reference_s = self._ahead_s - _DRIFT * (now_s - self._last_s)
        self._last_s, self._stamp_ns = now_s, stamp_ns
        if back_s > _BACKWARD_S:
            self._first_s, self._ahead_s = now_s, ahead_s
            return -back_s
        self._ahead_s = max(reference_s, ahead_s)
        is_known = now_s - self._first_s > _WARM_UP_S
        return ahead_s - reference_s if is_known and ahead_s - reference_s > _FORWARD_S else 0.0
