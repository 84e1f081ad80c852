# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Who is alive, by the age of what was last heard of them on a steady clock."""

from collections.abc import Callable
from collections.abc import Iterable
import time

from ivfmc_ros.errors import HelperError
from ivfmc_ros.errors import ParameterError


class Watch:
    """
    Ages of signs of life: heartbeats, joint states.

    Only the clock of this machine counts, never the stamps: clocks of a cell differ, and the one
    of a simulation stands still.
    """

    def __init__(self, limit: float, clock: Callable[[], float] = time.monotonic) -> None:
        """
        Watch without having heard of anybody.

        limit : seconds of silence after which somebody is lost
        """
        if not limit > 0.0:
            raise ParameterError(f'limit: {limit} s is not a positive time')
        self.limit = limit
        self._clock = clock
        self._heard: dict[str, float] = {}

    def hear(self, name: str) -> None:
        """Note a sign of life."""
        self._heard[name] = self._clock()

    def age(self, name: str) -> float:
        """Return the seconds since somebody was last heard of; infinite if never."""
        heard = self._heard.get(name)
        return float('inf') if heard is None else self._clock() - heard

    def silent(self, names: Iterable[str]) -> list[str]:
        """Return those of ``names`` that are lost."""
        return [name for name in names if self.age(name) > self.limit]

    def require(self, names: Iterable[str]) -> None:
        """:raises HelperError: somebody is lost; the code names the first, as CAMERA_LOST."""
        lost = self.silent(names)
        if not lost:
            return
        ages = ', '.join(f'{name} {_text(self.age(name))}' for name in lost)
        raise HelperError(f'{lost[0].upper()}_LOST', f'no sign of life: {ages}')


def _text(age: float) -> str:
    return 'never heard of' if age == float('inf') else f'silent for {age:.1f} s'
