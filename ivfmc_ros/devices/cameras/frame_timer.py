# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Timer that releases frames at a constant rate, on a steady clock."""

from collections.abc import Callable
import math
import time


class FrameTimer:
    """
    Evenly spaced deadlines for cameras that have no clock of their own.

    A caller that is late gets the present time, and the following deadlines are counted from
    it: frames are dropped then, none is delivered late.

    clock : returns steady seconds
    sleep : waits the given seconds
    """

    def __init__(
        self,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._clock, self._sleep = clock, sleep
        self._next_deadline = -math.inf

    def wait_next(self, period: float, timeout: float) -> float | None:
        """
        Wait for the next deadline and return it.

        period : seconds from this deadline to the one after it
        timeout : seconds, longest wait
        :returns: seconds of the clock, None if the deadline is later than ``timeout``
        """
        now = self._clock()
        deadline = max(self._next_deadline, now)
        if deadline - now > timeout:
            self._sleep(timeout)
            return None
        if deadline > now:
            self._sleep(deadline - now)
        self._next_deadline = deadline + period
        return deadline
