# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Parser of the lines that controllers of the GRBL family send.

Sources: the interface description of GRBL 1.1 (github.com/gnea/grbl, doc/markdown/interface.md),
report.c of GRBL 0.9j (github.com/grbl/grbl), report.c of grblHAL (github.com/grblHAL/core),
Report.cpp of FluidNC (github.com/bdring/FluidNC), report.c of Horus (github.com/bqlabs/horus-fw).
"""

from collections.abc import Callable
from dataclasses import dataclass
import math
import re

# Realtime bytes: soft reset (also turns spindle and coolant off at once), feed hold, resume,
# status query.
RESET = b'\x18'
HOLD = b'!'
RESUME = b'~'
STATUS = b'?'

# Queue is the state of GRBL 0.9 and Horus after a feed hold, Tool that of a grblHAL that waits for
# a tool change.
STATES = (
    *('Idle', 'Run', 'Hold', 'Jog', 'Alarm', 'Door', 'Check', 'Home', 'Sleep'),
    *('Queue', 'Tool'),
)

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
    ``ok``, ``error:<number>`` or ``error: <text>`` as response to a line that was sent.

    error : the number, UNNUMBERED for a text without one, None for ``ok``
    text : of an error, '' for a number
    """

    error: int | None = None
    text: str = ''


@dataclass(frozen=True, kw_only=True)
class Alarm:
    """``ALARM:<number>`` or ``ALARM: <text>``; the controller is locked from now on."""

    number: int


@dataclass(frozen=True, kw_only=True)
class Banner:
    """
    ``Grbl 1.1h [...]``, sent at each start and after each reset.

    version : as ``1.1h``, '' if bytes of it were lost
    firmware : one of FIRMWARES, '' if bytes of it were lost
    """

    version: str
    firmware: str = ''


@dataclass(frozen=True, kw_only=True)
class StatusReport:
    """
    A status report, ``<Idle|MPos:...>``. Fields that this report does not have are None.

    state : one of STATES
    substate : number after the state, as 0 of ``Hold:0``
    machine : positions of the axes in machine coordinates, controller units
    work, offset : the same in work coordinates, and machine - work
    outputs : letters of the outputs that are on (S or C for spindle, F for coolant)
    pins : letters of the inputs that are active (X, Y, Z limit switches, P probe); None where the
        firmware does not report them, and where a field of the report may be damaged
    decimals : of the positions, by axis: three of millimeters and degrees, four of inches ($13=1)
    """

    state: str
    substate: int | None = None
    machine: tuple[float, ...] | None = None
    work: tuple[float, ...] | None = None
    offset: tuple[float, ...] | None = None
    outputs: str | None = None
    pins: str | None = None
    decimals: tuple[int, ...] = ()

    def inches(self, index: int) -> bool:
        """
        Return whether the position of an axis is in inches.

        :raises IndexError: there is no such axis
        """
        return self.decimals[index] == _INCH_DECIMALS


@dataclass(frozen=True, kw_only=True)
class Setting:
    """
    ``$<key>=<value>``, one line of a listing of settings.

    key : a number, or a path in FluidNC, as ``/axes/x/max_rate_mm_per_min``
    value : of the number, 1 or 0 of ``true`` or ``false``; NaN for another text
    """

    key: str
    value: float


@dataclass(frozen=True, kw_only=True)
class Feedback:
    """
    ``[...]``, information for a human reader or about the firmware.

    key, value : before and after the first colon, as of ``[AXS:4:XYZA]``; without a colon the key
        is ''
    """

    key: str
    value: str


Line = Response | Alarm | Banner | StatusReport | Setting | Feedback

_ALARM_NAME = 'ALARM_'
UNNUMBERED = 0  # error or alarm of GRBL 0.9 whose text has no number of GRBL 1.1
FIRMWARES = ('Grbl', 'grblHAL', 'FluidNC', 'Horus')

_INCH_DECIMALS = 4
_POSITIONS = {'MPos': 'machine', 'WPos': 'work', 'WCO': 'offset'}
# A banner is recognized by its begin or its end, because a restart that is missed is a position
# that is lost without notice. grblHAL and FluidNC put their names into it.
_BANNER_MARKS = ('Grbl', 'Horus', 'for help]')
_BANNER_VERSION = re.compile(r'\d+\.\d+[a-z]*')
# FluidNC and GrblHAL contain the name Grbl as well.
_BANNER_FIRMWARE = {'FluidNC': 'FluidNC', 'GrblHAL': 'grblHAL', 'Horus': 'Horus', 'Grbl': 'Grbl'}
# Three decimals are millimeters or degrees, four are inches; one lost byte changes the format.
_NUMBER = re.compile(r'-?\d+\.(\d{3,4})')
# Texts of GRBL 0.9 and Horus for what GRBL 1.1 numbers.
_ALARM_TEXTS = {'Hard/soft limit': 1, 'Hard limit': 1, 'Soft limit': 2, 'Abort during cycle': 3}
_ERROR_TEXTS = {
    'Expected command letter': 1,
    'Bad number format': 2,
    'Invalid statement': 3,
    'Setting disabled': 5,
    'Homing not enabled': 5,
    'Not idle': 8,
    'Alarm lock': 9,
    'Line overflow': 11,
    'Undefined feed rate': 22,
}
_ERROR_ID = re.compile(r'Invalid gcode ID:(\d{1,3})')
# Fields of GRBL 1.1; in another one, the letters of the pins may have lost their key.
_FIELD = re.compile(r'(MPos|WPos|WCO|Bf|Ln|F|FS|Pn|Ov|A):([\w.,-]+)')
# Fields of grblHAL and FluidNC; a lost character makes none of them of the pins.
_FURTHER_FIELD = re.compile(r'(?:A|AR|D|DTG|FW|H|In|MPG|S|SD|Sc|T|TLR|WCS):[^|<>:]*|P:\d+|AR')
_BOOLEANS = {'true': 1.0, 'false': 0.0}
_LINES: tuple[tuple[re.Pattern[str], Callable[[re.Match[str]], Line]], ...] = (
    (re.compile(r'ok'), lambda match: Response()),
    (re.compile(r'error:(\d{1,3})'), lambda match: Response(error=int(match[1]))),
    (re.compile(r'error: ([A-Z].*)'), lambda match: _text_error(match[1])),
    (re.compile(r'ALARM:(\d{1,3})'), lambda match: Alarm(number=int(match[1]))),
    (
        re.compile(r'ALARM: ([A-Z].*)'),
        lambda match: Alarm(number=_ALARM_TEXTS.get(match[1], UNNUMBERED)),
    ),
    (
        re.compile(r'\$(\d{1,3}|/[\w/]+)=([^$<>=(]*?)(?: \([^$<>]*)?'),
        lambda match: Setting(key=match[1], value=_setting_value(match[2])),
    ),
    (re.compile(r'\[(?:([^\[\]:]*):)?(.*)\]'), lambda match: _feedback(match[1], match[2])),
)


def parse(text: str) -> Line | None:
    """Return the parsed line, None if it is no line of the GRBL family, or is damaged."""
    if text.startswith('<'):
        return _parse_report(text)
    for pattern, build in _LINES:
        if match := pattern.fullmatch(text):
            return build(match)
    if any(mark in text for mark in _BANNER_MARKS):
        version = _BANNER_VERSION.search(text)
        firmware = next((name for mark, name in _BANNER_FIRMWARE.items() if mark in text), '')
        return Banner(version=version[0] if version else '', firmware=firmware)
    return None


def name_alarm(line: Alarm) -> str:
    """Return the name of an alarm, see ControllerState.alarm."""
    return f'{_ALARM_NAME}{line.number}'


def describe_alarm(name: str) -> str:
    """Return the name of an alarm with its meaning."""
    number = name.removeprefix(_ALARM_NAME)
    meaning = ALARMS.get(int(number), '') if number.isdecimal() else ''
    return f'{name} ({meaning})' if meaning else name


def _text_error(text: str) -> Response:
    identified = _ERROR_ID.fullmatch(text)
    number = int(identified[1]) if identified else _ERROR_TEXTS.get(text, UNNUMBERED)
    return Response(error=number, text=text)


def _setting_value(text: str) -> float:
    if text in _BOOLEANS:
        return _BOOLEANS[text]
    return float(text) if re.fullmatch(r'-?\d+(\.\d+)?', text, re.ASCII) else math.nan


def _feedback(key: str | None, value: str) -> Feedback:
    return Feedback(key=(key or '').strip(), value=value.strip())


def _parse_report(text: str) -> StatusReport | None:
    # a second bracket: the line end between two reports was lost
    if not text.endswith('>') or '<' in text[1:] or '>' in text[:-1]:
        return None
    state, fields = _split_report(text[1:-1])
    name, colon, substate = state.partition(':')
    if name not in STATES or (colon and not (substate.isascii() and substate.isdigit())):
        return None
    positions: dict[str, tuple[float, ...]] = {}
    formats: set[tuple[int, ...]] = set()
    outputs = None
    for field in fields:
        key, _, value = field.partition(':')
        if key in _POSITIONS:
            matches = [_NUMBER.fullmatch(part) for part in value.split(',')]
            if None in matches or _POSITIONS[key] in positions:
                return None
            formats.add(tuple(len(match[1]) for match in matches if match))
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
        pins=_pins(fields) if '|' in text else None,
        decimals=formats.pop(),
        **positions,
    )


def _pins(fields: list[str]) -> str | None:
    """Return the letters of the inputs that are active; GRBL omits the field if none is."""
    known = [field for field in fields if not _FURTHER_FIELD.fullmatch(field)]
    matches = [_FIELD.fullmatch(field) for field in known]
    if None in matches:
        return None
    return next((match[2] for match in matches if match and match[1] == 'Pn'), '')


def _split_report(text: str) -> tuple[str, list[str]]:
    """Return the state and the fields of a report, also of GRBL 0.9, which has commas only."""
    if '|' in text:
        state, *fields = text.split('|')
        return state, fields
    state, *rest = text.split(',')
    fields = []
    for part in rest:
        if ':' in part or not fields:
            fields.append(part)
        else:
            fields[-1] += f',{part}'
    return state, fields
