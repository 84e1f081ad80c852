# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What GRBL 1.1 says, line by line."""

from collections.abc import Callable
from dataclasses import dataclass
import math
import re

# Soft reset, which also kills spindle and coolant at once; feed hold; resume; status.
RESET = b'\x18'
HOLD = b'!'
RESUME = b'~'
STATUS = b'?'

STATES = ('Idle', 'Run', 'Hold', 'Jog', 'Alarm', 'Door', 'Check', 'Home', 'Sleep')

ERRORS = {
    1: 'a word without its letter',
    2: 'a number that cannot be read',
    3: 'an unknown command',
    5: 'homing is not enabled ($22=1)',
    8: 'only possible when idle',
    9: 'the board is locked; home it or clear the alarm',
    11: 'the line is too long',
    15: 'the target is outside of the travel',
    22: 'the feed rate is missing',
    33: 'the target is impossible',
}
ALARMS = {
    1: 'a limit switch was hit',
    2: 'the target is outside of the travel (soft limit)',
    3: 'reset while moving, the position is lost',
    6: 'homing was interrupted by a reset',
    7: 'homing was interrupted by the door',
    8: 'homing did not leave the switch',
    9: 'homing did not find the switch',
}


@dataclass(frozen=True, kw_only=True)
class Answer:
    """``ok``, or ``error:<number>``, to a line that was sent."""

    error: int | None = None


@dataclass(frozen=True, kw_only=True)
class Alarm:
    """``ALARM:<number>``."""

    number: int


@dataclass(frozen=True, kw_only=True)
class Banner:
    """The board has started."""

    version: str


@dataclass(frozen=True, kw_only=True)
class Report:
    """
    A status report.

    state : one of STATES; substate : 0 of ``Hold:0``, None when there is none
    machine : positions of the axes in machine coordinates, board units; None when not said
    work, offset : the same in work coordinates, and machine - work
    outputs : letters of what is on (S or C spindle, F coolant), None when not said
    """

    state: str
    substate: int | None = None
    machine: tuple[float, ...] | None = None
    work: tuple[float, ...] | None = None
    offset: tuple[float, ...] | None = None
    outputs: str | None = None


@dataclass(frozen=True, kw_only=True)
class Setting:
    """One line of the answer to ``$$``."""

    number: int
    value: float


@dataclass(frozen=True, kw_only=True)
class Message:
    """Something in brackets, for a reader."""

    text: str


Line = Answer | Alarm | Banner | Report | Setting | Message

_POSITIONS = {'MPos': 'machine', 'WPos': 'work', 'WCO': 'offset'}
_LINES: tuple[tuple[re.Pattern[str], Callable[[re.Match[str]], Line]], ...] = (
    (re.compile(r'ok'), lambda match: Answer()),
    (re.compile(r'error:(\d{1,3})'), lambda match: Answer(error=int(match[1]))),
    (re.compile(r'ALARM:(\d{1,3})'), lambda match: Alarm(number=int(match[1]))),
    (
        re.compile(r"Grbl (\d+\.\d+\w*) \['\$' for help\]"),
        lambda match: Banner(version=match[1]),
    ),
    (
        re.compile(r'\$(\d{1,3})=(-?\d+(?:\.\d+)?)(?: .*)?'),
        lambda match: Setting(number=int(match[1]), value=float(match[2])),
    ),
    (re.compile(r'\[(.*)\]'), lambda match: Message(text=match[1])),
)


def parse(text: str) -> Line | None:
    """Return what a line says, None if it is nothing that GRBL says: it was garbled."""
    if text.startswith('<'):
        return _report(text)
    for pattern, build in _LINES:
        if match := pattern.fullmatch(text):
            return build(match)
    return None


def _report(text: str) -> Report | None:
    if not text.endswith('>'):
        return None
    state, *fields = text[1:-1].split('|')
    name, _, substate = state.partition(':')
    if name not in STATES or not (substate == '' or substate.isdecimal()):
        return None
    positions: dict[str, tuple[float, ...]] = {}
    outputs = None
    for field in fields:
        key, _, value = field.partition(':')
        if key in _POSITIONS:
            numbers = _numbers(value)
            if numbers is None:
                return None
            positions[_POSITIONS[key]] = numbers
        elif key == 'Ov':
            # outputs that are off are not said, but only where overrides are
            outputs = outputs or ''
        elif key == 'A':
            outputs = value
    if 'machine' not in positions and 'work' not in positions:
        return None
    return Report(
        state=name,
        substate=int(substate) if substate else None,
        outputs=outputs,
        **positions,
    )


def _numbers(text: str) -> tuple[float, ...] | None:
    try:
        numbers = tuple(float(part) for part in text.split(','))
    except ValueError:
        return None
    return numbers if all(math.isfinite(number) for number in numbers) else None
