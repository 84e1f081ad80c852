# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Ticks at a rate, on a clock that never jumps."""

from collections.abc import Callable
import math
import time


class Pacer:
    """
    Tells when the next of evenly spaced moments comes.

    Who asks late gets the present moment, and the following ones are counted from it: pictures
    are lost then, and none is old.
    """

    def __init__(
        self,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._clock, self._sleep = clock, sleep
        self._next = -math.inf

    def next(self, period: float, seconds: float) -> float | None:
        """Wait for the next moment and return it; None if it does not come in ``seconds``."""
        now = self._clock()
        due = max(self._next, now)
        if due - now > seconds:
            self._sleep(seconds)
            return None
        if due > now:
            self._sleep(due - now)
        self._next = due + period
        return due
