# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Parser of the lines that a GRBL 1.1 controller sends.

Source: the interface description of GRBL 1.1 (github.com/gnea/grbl, doc/markdown/interface.md).
"""

from collections.abc import Callable
from dataclasses import dataclass
import re

# Realtime bytes: soft reset (also turns spindle and coolant off at once), feed hold, resume,
# status query.
RESET = b'\x18'
HOLD = b'!'
RESUME = b'~'
STATUS = b'?'

STATES = ('Idle', 'Run', 'Hold', 'Jog', 'Alarm', 'Door', 'Check', 'Home', 'Sleep')

# Codes that a user may meet, and what they mean (doc/csv of GRBL 1.1).
ERRORS = {
    1: 'a value without its letter',
    2: 'a number that cannot be read',
    3: 'an unknown command',
    5: 'homing is not enabled ($22=1 enables it)',
    8: 'possible only when the controller is idle',
    9: 'the controller is locked; call home or clear_alarm',
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
    7: 'homing was interrupted by the safety door',
    8: 'homing did not release the switch',
    9: 'homing did not find the switch',
}


@dataclass(frozen=True, kw_only=True)
class Response:
    """
    ``ok`` or ``error:<number>`` as response to a line that was sent.

    error : the number, None for ``ok``
    """

    error: int | None = None


@dataclass(frozen=True, kw_only=True)
class Alarm:
    """``ALARM:<number>``; the controller is locked from now on."""

    number: int


@dataclass(frozen=True, kw_only=True)
class Banner:
    """
    ``Grbl 1.1h [...]``, sent at each start and after each reset.

    version : as ``1.1h``, '' if bytes of it were lost
    """

    version: str


@dataclass(frozen=True, kw_only=True)
class StatusReport:
    """
    A status report, ``<Idle|MPos:...>``. Fields that this report does not have are None.

    state : one of STATES
    substate : number after the state, as 0 of ``Hold:0``
    machine : positions of the axes in machine coordinates, controller units
    work, offset : the same in work coordinates, and machine - work
    outputs : letters of the outputs that are on (S or C for spindle, F for coolant)
    inches : whether the positions have the format of inches ($13=1), with four decimals
    """

    state: str
    substate: int | None = None
    machine: tuple[float, ...] | None = None
    work: tuple[float, ...] | None = None
    offset: tuple[float, ...] | None = None
    outputs: str | None = None
    inches: bool = False


@dataclass(frozen=True, kw_only=True)
class Setting:
    """``$<number>=<value>``, one line of the response to ``$$``."""

    number: int
    value: float


@dataclass(frozen=True, kw_only=True)
class Feedback:
    """``[...]``, a message for a human reader."""

    text: str


Line = Response | Alarm | Banner | StatusReport | Setting | Feedback

_INCH_DECIMALS = 4
_POSITIONS = {'MPos': 'machine', 'WPos': 'work', 'WCO': 'offset'}
# A banner is recognized by its begin or its end, because a restart that is missed is a position
# that is lost without notice. grblHAL and FluidNC put their names into it.
_BANNER_MARKS = ('Grbl', 'for help]')
_BANNER_VERSION = re.compile(r'\d+\.\d+[a-z]*')
# Three decimals are millimeters or degrees, four are inches; one lost byte changes the format.
_NUMBER = re.compile(r'-?\d+\.(\d{3,4})')
_LINES: tuple[tuple[re.Pattern[str], Callable[[re.Match[str]], Line]], ...] = (
    (re.compile(r'ok'), lambda match: Response()),
    (re.compile(r'error:(\d{1,3})'), lambda match: Response(error=int(match[1]))),
    (re.compile(r'ALARM:(\d{1,3})'), lambda match: Alarm(number=int(match[1]))),
    (
        re.compile(r'\$(\d{1,3})=(-?\d+(?:\.\d{3})?)(?: \([^$<>]*)?'),
        lambda match: Setting(number=int(match[1]), value=float(match[2])),
    ),
    (re.compile(r'\[(.*)\]'), lambda match: Feedback(text=match[1])),
)


def parse(text: str) -> Line | None:
    """Return the parsed line, None if it is no line of GRBL (damaged by a transmission error)."""
    if text.startswith('<'):
        return _parse_report(text)
    for pattern, build in _LINES:
        if match := pattern.fullmatch(text):
            return build(match)
    if any(mark in text for mark in _BANNER_MARKS):
        version = _BANNER_VERSION.search(text)
        return Banner(version=version[0] if version else '')
    return None


def _parse_report(text: str) -> StatusReport | None:
    # a second bracket: the line end between two reports was lost
    if not text.endswith('>') or '<' in text[1:] or '>' in text[:-1]:
        return None
    state, *fields = text[1:-1].split('|')
    name, colon, substate = state.partition(':')
    if name not in STATES or (colon and not substate.isdecimal()):
        return None
    positions: dict[str, tuple[float, ...]] = {}
    formats: set[int] = set()
    outputs = None
    for field in fields:
        key, _, value = field.partition(':')
        if key in _POSITIONS:
            matches = [_NUMBER.fullmatch(part) for part in value.split(',')]
            if None in matches or _POSITIONS[key] in positions:
                return None
            formats.update(len(match[1]) for match in matches if match)
            positions[_POSITIONS[key]] = tuple(float(match[0]) for match in matches if match)
        elif key == 'Ov':
            # GRBL reports outputs with the overrides; without a field A all are off
            outputs = outputs or ''
        elif key == 'A':
            outputs = value
    if ('machine' not in positions and 'work' not in positions) or len(formats) != 1:
        return None
    return StatusReport(
        state=name,
        substate=int(substate) if substate else None,
        outputs=outputs,
        inches=formats == {_INCH_DECIMALS},
        **positions,
    )
