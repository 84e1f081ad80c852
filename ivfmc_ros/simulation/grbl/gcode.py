# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parser of G-code blocks with the error numbers of GRBL (gcode.c), for an emulation."""

from collections.abc import Mapping
from dataclasses import dataclass
from dataclasses import field
import re

_WORD = re.compile(r'([A-Z])([-+]?(?:\d+\.?\d*|\.\d+))')
_COMMENT = re.compile(r'\([^)]*\)?|;.*')

# Modal groups: a block may have one code of each.
GRBL_GROUPS: Mapping[str, tuple[str, ...]] = {
    'motion': ('G0', 'G1'),
    'dwell': ('G4', 'G53'),
    'plane': ('G17',),
    'distance': ('G90', 'G91'),
    'feed': ('G94',),
    'units': ('G21',),
    'work': ('G54',),
    'end': ('M0', 'M1', 'M2', 'M30'),
    'spindle': ('M3', 'M4', 'M5'),
    'coolant': ('M8', 'M9'),
}
HORUS_GROUPS: Mapping[str, tuple[str, ...]] = {
    'motion': ('G1',),
    'origin': ('G50',),
    'end': ('M0', 'M2'),
    'motor': ('M17', 'M18'),
    'sensor': ('M50',),
    'laser': ('M70', 'M71'),
}
_VALUES = 'FNPST'

# Error numbers of GRBL 1.1.
BAD_LETTER, BAD_NUMBER, NEGATIVE = 1, 2, 4
UNSUPPORTED, TWICE_IN_GROUP, NO_FEED, NOT_WHOLE, TWO_MOTIONS, REPEATED = 20, 21, 22, 23, 24, 25
MISSING = 28


class GcodeError(Exception):
    """The controller responds with ``error:<number>``."""

    def __init__(self, number: int) -> None:
        super().__init__(f'error:{number}')
        self.number = number


@dataclass(frozen=True, kw_only=True)
class GcodeBlock:
    """
    One parsed line.

    codes : G or M code by modal group
    values : values by letter
    moves : whether the block names a target position
    """

    codes: dict[str, str] = field(default_factory=dict)
    values: dict[str, float] = field(default_factory=dict)
    moves: bool = False


def clean(text: str) -> str:
    """Return a line in upper case, without spaces and comments."""
    return ''.join(_COMMENT.sub('', text).split()).upper()


def parse_block(
    text: str, axes: str = 'XYZ', groups: Mapping[str, tuple[str, ...]] = GRBL_GROUPS
) -> GcodeBlock:
    """
    Return the block of a cleaned line.

    axes : letters of the axes
    groups : codes that the controller knows, by modal group
    :raises GcodeError: with the error number of GRBL
    """
    codes: dict[str, str] = {}
    values: dict[str, float] = {}
    at = 0
    while at < len(text):
        match = _WORD.match(text, at)
        if match is None:
            raise GcodeError(BAD_NUMBER if text[at].isalpha() else BAD_LETTER)
        at = match.end()
        if match[1] in 'GM':
            _add_code(match[1], float(match[2]), codes, groups)
        elif match[1] in _VALUES + axes:
            _add_value(match[1], float(match[2]), values)
        else:
            raise GcodeError(UNSUPPORTED)
    moves = any(axis in values for axis in axes)
    return GcodeBlock(codes=codes, values=values, moves=moves)


def _add_code(
    letter: str, value: float, codes: dict[str, str], groups: Mapping[str, tuple[str, ...]]
) -> None:
    if value != int(value):
        raise GcodeError(UNSUPPORTED if letter == 'G' else NOT_WHOLE)
    code = f'{letter}{int(value)}'
    group = next((name for name, known in groups.items() if code in known), None)
    if group is None:
        raise GcodeError(UNSUPPORTED)
    if group in codes:
        raise GcodeError(TWO_MOTIONS if group == 'motion' else TWICE_IN_GROUP)
    codes[group] = code


def _add_value(letter: str, value: float, values: dict[str, float]) -> None:
    if letter in values:
        raise GcodeError(REPEATED)
    if letter in 'FNPST' and value < 0:
        raise GcodeError(NEGATIVE)
    values[letter] = value
