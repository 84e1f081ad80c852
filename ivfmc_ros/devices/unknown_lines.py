# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Lines of a controller that its driver does not understand: counted by kind, never an error."""

from collections import Counter
from collections.abc import Mapping
import re
import threading

# Digits that make two lines of one kind different.
_DIGITS = re.compile(r'\d+')
_MAX_LENGTH = 40  # characters of a kind: enough to find a message in the firmware's sources
# Kinds that are told apart: noise on the line has a new kind with each line.
_MAX_KINDS = 50
OTHERS = 'others'


class UnknownLines:
    """Counts lines by kind, which is the line without its digits. Thread safe."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()
        self._lock = threading.Lock()

    def add(self, text: str) -> None:
        """Count a line; empty ones are none."""
        if not text.strip():
            return
        kind = ascii(_DIGITS.sub('#', text.strip())[:_MAX_LENGTH])[1:-1]
        with self._lock:
            if kind not in self._counts and len(self._counts) >= _MAX_KINDS:
                kind = OTHERS
            self._counts[kind] += 1

    def counts(self) -> Mapping[str, int]:
        """Return the number of lines of each kind since the start of the driver."""
        with self._lock:
            return dict(self._counts)
