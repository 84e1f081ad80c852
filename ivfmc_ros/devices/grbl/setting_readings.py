# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Values of a controller's ``$`` settings from repeated listings.

GRBL's lines have no checksum: ``$110=500.000`` that lost a byte is ``$110=50.000``, or a value of
``$10``. A value counts when two listings agree on it.
"""

from collections import Counter
from collections import defaultdict
from collections.abc import Iterable

_NEEDED = 2  # equal readings of a value


class SettingReadings:
    """Readings of all settings since ``clear``."""

    def __init__(self) -> None:
        self._readings: defaultdict[int, Counter[float]] = defaultdict(Counter)
        self._listings = 0

    def clear(self) -> None:
        """Forget all readings."""
        self._readings.clear()
        self._listings = 0

    def end_listing(self) -> None:
        """Note that a listing (the response to ``$$``) is complete."""
        self._listings += 1

    def add(self, number: int, value: float) -> None:
        """Note one line of a listing."""
        self._readings[number][value] += 1

    def values(self) -> dict[int, float]:
        """Return the values that were read at least twice, by number."""
        common = {number: found.most_common(1)[0] for number, found in self._readings.items()}
        return {number: value for number, (value, n) in common.items() if n >= _NEEDED}

    def unsettled(self, numbers: Iterable[int]) -> list[int]:
        """Return those of ``numbers`` that need another listing; absent from two is settled."""
        settled = self.values()
        return [
            number
            for number in numbers
            if number not in settled and (self._readings.get(number) or self._listings < _NEEDED)
        ]
