# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Checks by the reported positions that the table executes the move that was commanded."""

from collections.abc import Callable
import math
import time

# Seconds of reports without motion after which a table that had begun to move stands. The beam may
# shine on a standing table for no more than a second.
_STALL_S = 0.5
# Seconds of reports until a table has begun to move: a driver may have to turn a laser off first.
_START_S = 2.0
# Fraction of the position tolerance that counts as motion: above the noise of an encoder.
_NOISE = 0.1
# A slow move is given the time in which it covers the noise so many times.
_NOISE_STEPS = 4.0
# Tolerances by which a table may be off the way from start to target, in two reports in a row.
_OFF_COURSE = 10.0
# Seconds that one report counts at most: after a longer silence the age of reports decides.
_MAX_PERIOD_S = 0.25


class MotionCheck:
    """
    One move of the table, from its command to its arrival.

    Time counts only while reports arrive, so that a process that was stopped or starved, here or
    in the driver, is not taken for a table that stands.

    reach : greatest distance from the target, radians, at which the table has arrived; never more
        than half of the move, so that a table that has not begun has not arrived
    """

    def __init__(
        self,
        *,
        start: float,
        target: float,
        velocity: float,
        tolerance: float,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """
        Begin a move.

        start, target : radians
        velocity : commanded speed, rad/s, positive
        tolerance : of table positions, radians
        """
        noise = _NOISE * tolerance
        self.reach = max(min(tolerance, 0.5 * abs(target - start)), noise)
        self._start, self._target, self._tolerance = start, target, tolerance
        self._noise, self._slow_s = noise, _NOISE_STEPS * noise / velocity
        self._clock = clock
        self._last_s = clock()
        self._elapsed_s = 0.0
        self._anchor, self._anchor_s = start, 0.0  # where and when the table moved last
        self._begun = False
        self._off_course = 0

    def update(self, position: float) -> str:
        """Evaluate a new report, radians; return what is wrong with the motion, '' if nothing."""
        now = self._clock()
        self._elapsed_s += min(now - self._last_s, _MAX_PERIOD_S)
        self._last_s = now
        if abs(position - self._anchor) > self._noise:
            self._anchor, self._anchor_s, self._begun = position, self._elapsed_s, True
        off_course = self._distance_off_course(position) > _OFF_COURSE * self._tolerance
        self._off_course = self._off_course + 1 if off_course else 0
        if self._off_course >= 2:
            return f'the table left its way and is at {math.degrees(position):.2f} degrees'
        allowed_s = max(_STALL_S if self._begun else _START_S, self._slow_s)
        stands = self._elapsed_s - self._anchor_s > allowed_s
        if stands and abs(position - self._target) > self.reach:
            return f'the table stands at {math.degrees(position):.2f} degrees'
        return ''

    @property
    def waited_s(self) -> float:
        """Seconds for which the table has not begun to move; 0 when it has."""
        return 0.0 if self._begun else self._elapsed_s

    def _distance_off_course(self, position: float) -> float:
        low, high = sorted((self._start, self._target))
        return max(low - position, position - high, 0.0)
