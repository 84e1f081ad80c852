# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""When a process of a cell that ended is started again: later each time, and not too often."""

from collections import defaultdict
from collections.abc import Callable
import time

from ivfmc_ros.errors import HelperError

# Seconds until the first restart of a process; each further one takes twice as long ...
_FIRST_S = 0.5
# ... up to this.
_LONGEST_S = 30.0
# Most restarts of one process within so many seconds: a process that fails at once is given up
# after 0.5 + 1 + 2 + 4 + 8 s and the time that it runs.
MOST, _WITHIN_S = 5, 600.0


class Restarts:
    """Counts the restarts of each process of a cell."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """``clock`` : returns steady seconds."""
        self._clock = clock
        self._ended_s: dict[str, list[float]] = defaultdict(list)
        self._due_s: dict[str, float] = {}

    @property
    def pending(self) -> set[str]:
        """Names of the processes that ended and are not started again yet."""
        return set(self._due_s)

    def add(self, name: str) -> tuple[float, int]:
        """
        Note that a process has ended.

        returns : seconds until it is to be started again; how many restarts there were lately
        :raises HelperError: it ended too often
        """
        now_s = self._clock()
        lately = [at for at in self._ended_s[name] if now_s - at < _WITHIN_S]
        self._ended_s[name] = [*lately, now_s]
        if len(lately) >= MOST:
            raise HelperError(
                'NODE_DIED',
                f'{name} ended {len(lately) + 1} times within {_WITHIN_S / 60:.0f} minutes',
            )
        delay_s = min(_FIRST_S * 2.0 ** len(lately), _LONGEST_S)
        self._due_s[name] = now_s + delay_s
        return delay_s, len(lately) + 1

    def due(self) -> list[str]:
        """Return the processes that are to be started now; they are pending no longer."""
        names = [name for name, at in self._due_s.items() if self._clock() >= at]
        for name in names:
            del self._due_s[name]
        return names
