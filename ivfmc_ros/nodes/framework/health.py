# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is wrong with a node right now, each trouble under a name of its own. No ROS."""

from collections.abc import Callable
from enum import IntEnum


class Level(IntEnum):
    """As in diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


class Health:
    """
    Conditions by name; the worst one is what the node says of itself.

    report : told (name, level, message) once, whenever a condition changes
    """

    def __init__(self, report: Callable[[str, Level, str], None]) -> None:
        self._report = report
        self._conditions: dict[str, tuple[Level, str]] = {}

    def set(self, name: str, level: Level, message: str) -> None:
        """State a condition; OK without a message takes it back."""
        before = self._conditions.get(name)
        if level is Level.OK and not message:
            self.clear(name)
        elif before != (level, message):
            self._conditions[name] = (level, message)
            self._report(name, level, message)

    def clear(self, name: str) -> None:
        """Take a condition back."""
        gone = self._conditions.pop(name, None)
        if gone is not None and gone[0] is not Level.OK:
            self._report(name, Level.OK, f'over: {gone[1]}')

    @property
    def conditions(self) -> dict[str, str]:
        """The message of every condition by name."""
        return {name: message for name, (_, message) in self._conditions.items()}

    def worst(self) -> tuple[Level, str]:
        """Return the level of the worst condition and the messages of that level."""
        level = max((level for level, _ in self._conditions.values()), default=Level.OK)
        messages = [message for have, message in self._conditions.values() if have is level]
        return level, '; '.join(messages)
