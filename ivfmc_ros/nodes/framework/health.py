# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Conditions of a node, for its diagnostics and its log. No ROS.

A condition is identified by its kind (such as ``waiting`` or an error code) and its object (topic,
joint, laser, file). Its message may change at any time and is no part of the identity: diagnostics
always show the newest message, the log has one line when a condition begins and one when it ends.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
import time

WAITING = 'waiting'

# Seconds that a condition has to be over before the log says so. A condition that comes and goes
# with alternating messages (two publishers on a topic) stays one condition that way.
SETTLE_S = 1.0

_Identity = tuple[str, str]


class Level(IntEnum):
    """As in diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True)
class _Condition:
    level: Level
    message: str
    recovered: str


class Health:
    """
    The present conditions of a node.

    log : called with (level, line) when a condition begins, changes its level, or ends
    clock : steady clock, seconds
    """

    def __init__(
        self, log: Callable[[Level, str], None], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._log = log
        self._clock = clock
        self._conditions: dict[_Identity, _Condition] = {}
        self._faults: dict[str, str] = {}
        # levels at which a condition is in the log since it began
        self._logged: dict[_Identity, set[Level]] = {}
        # when a condition that is in the log ended, and the line that says so
        self._ended: dict[_Identity, tuple[float, str]] = {}

    def set(
        self, kind: str, subject: str, level: Level, message: str, recovered: str = 'recovered'
    ) -> None:
        """
        Begin a condition, or change its level or message.

        subject : the object that it concerns, such as a topic; begins the lines in the log
        level : OK for a condition that belongs to normal operation, logged as information
        recovered : what the log says of the object when the condition has ended
        """
        identity = kind, subject
        self._conditions[identity] = _Condition(level, message, recovered)
        self._ended.pop(identity, None)
        logged = self._logged.setdefault(identity, set())
        if level not in logged:
            logged.add(level)
            self._log(level, _line(subject, message))

    def clear(self, kind: str, subject: str) -> None:
        """End a condition; does nothing where it does not exist."""
        condition = self._conditions.pop((kind, subject), None)
        if condition is not None:
            line = f'{subject}: {condition.recovered}'
            self._ended[kind, subject] = self._clock(), line

    def has(self, kind: str, subject: str) -> bool:
        """Return whether the condition exists now."""
        return (kind, subject) in self._conditions

    def fault(self, subject: str, kind: str, message: str, level: Level = Level.ERROR) -> None:
        """Set the fault of an object; one of another kind ends: an object has one at a time."""
        if self._faults.get(subject, kind) != kind:
            self.clear_fault(subject)
        self._faults[subject] = kind
        self.set(kind, subject, level, message)

    def clear_fault(self, subject: str) -> None:
        """End the fault of an object, whatever its kind."""
        kind = self._faults.pop(subject, None)
        if kind is not None:
            self.clear(kind, subject)

    def log_ended(self) -> None:
        """Log the conditions that have been over for ``SETTLE_S``; to be called periodically."""
        now = self._clock()
        for identity, (ended_s, line) in list(self._ended.items()):
            if now - ended_s >= SETTLE_S:
                del self._ended[identity], self._logged[identity]
                self._log(Level.OK, line)

    @property
    def messages(self) -> dict[str, str]:
        """The message of every condition by 'object: kind'."""
        return {
            f'{subject}: {kind}': condition.message
            for (kind, subject), condition in self._conditions.items()
        }

    def worst(self) -> tuple[Level, str]:
        """Return the highest level, OK without a condition, and the messages of that level."""
        conditions = self._conditions.items()
        level = max((condition.level for _, condition in conditions), default=Level.OK)
        lines = [_line(key[1], found.message) for key, found in conditions if found.level is level]
        return level, '; '.join(lines)


def _line(subject: str, message: str) -> str:
    return message if message.startswith(subject) else f'{subject}: {message}'
