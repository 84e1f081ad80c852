# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""State of the nodes of a cell, by their diagnostics."""

from collections.abc import Callable
from typing import Any

_LEVELS = ('ok', 'warning', 'error', 'lost')
# Diagnostics come once a second; a node that is silent for so long is lost.
_LOST_S = 3.0


class NodeHealth:
    """Keeps the last diagnostics of each node in a namespace."""

    def __init__(self, namespace: str, clock: Callable[[], float]) -> None:
        """``clock`` : steady, seconds."""
        self._prefix = namespace.strip('/')
        self._clock = clock
        self._last: dict[str, tuple[float, str, str]] = {}

    def add(self, status: Any) -> None:
        """Take a diagnostic_msgs/DiagnosticStatus; those of other cells are ignored."""
        name = status.name.strip('/')
        head, _, node = name.rpartition('/')
        if head != self._prefix or ' ' in node:
            return
        level = _LEVELS[min(int.from_bytes(status.level, 'little'), len(_LEVELS) - 1)]
        self._last[node] = self._clock(), level, status.message
        ended = next((item.value for item in status.values if item.key == 'ended'), '')
        if node == 'up' and ended:
            self._last[ended] = self._clock(), 'lost', status.message

    def rows(self) -> list[tuple[str, str, str]]:
        """Return name, level (ok, warning, error, lost) and message of each node, by name."""
        now = self._clock()
        return [
            (name, level, message)
            if now - heard_s < _LOST_S
            else (name, 'lost', f'silent for {now - heard_s:.0f} s')
            for name, (heard_s, level, message) in sorted(self._last.items())
        ]
