# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Parser of the lines that Marlin sends.

Source: the descriptions of G-codes at marlinfw.org (M114, M115, M503, host keepalive).
"""

from dataclasses import dataclass
import re

# ``ok``, also with the advanced fields (``ok P15 B3``) or a temperature.
_END = re.compile(r'ok(?:$| .*)')
_BUSY = re.compile(r'echo:\s*busy:.*')
_START = re.compile(r'start')
# The firmware has stopped for good; it needs a reset.
_HALT = re.compile(r'Error:.*(?:halted|kill\(\) called|stopped due to errors).*', re.IGNORECASE)
_POSITION = re.compile(
    r'((?:[A-Z]:\s*-?\d+(?:\.\d+)?\s*)+)Count\s+((?:[A-Z]:\s*-?\d+\s*)+)', re.ASCII
)
_VALUE = re.compile(r'([A-Z]):\s*(-?\d+(?:\.\d+)?)', re.ASCII)
_SETTING = re.compile(r'(?:echo:)?\s*(M\d+)((?:\s+[A-Z]-?\d+(?:\.\d+)?)+)\s*(?:;.*)?', re.ASCII)
_WORD = re.compile(r'([A-Z])(-?\d+(?:\.\d+)?)', re.ASCII)
_NAME = re.compile(r'FIRMWARE_NAME:\s*(\S+(?:\s+\S+)?)')
# What Marlin says at its start, and without being asked.
_CHATTER = re.compile(
    r'(echo:|//|Cap:|FIRMWARE_NAME|External Reset|PowerUp|Software Reset|Brown out Reset'
    r'|Watchdog Reset|Marlin| ?T:|X:|wait$).*'
)


@dataclass(frozen=True, kw_only=True)
class MarlinPosition:
    """
    Answer to ``M114``.

    commanded : where the last move in the queue ends, controller units by axis letter
    steps : where the stepper motors are, steps by axis letter
    """

    commanded: dict[str, float]
    steps: dict[str, int]


def is_end(text: str) -> bool:
    """Return whether a line ends an answer."""
    return bool(_END.fullmatch(text))


def is_busy(text: str) -> bool:
    """Return whether a line says that the firmware is at work (host keepalive)."""
    return bool(_BUSY.fullmatch(text))


def is_start(text: str) -> bool:
    """Return whether a line is the greeting after a start."""
    return bool(_START.fullmatch(text))


def is_halt(text: str) -> bool:
    """Return whether a line says that the firmware has stopped for good."""
    return bool(_HALT.fullmatch(text))


def is_understood(text: str) -> bool:
    """Return whether a line belongs to what Marlin is known to send."""
    known = (_END, _BUSY, _START, _HALT, _SETTING, _POSITION, _CHATTER)
    return any(pattern.fullmatch(text) for pattern in known)


def parse_position(text: str) -> MarlinPosition | None:
    """Return the position of an answer to ``M114``, None for another line."""
    match = _POSITION.fullmatch(text.strip())
    if match is None:
        return None
    return MarlinPosition(
        commanded={letter: float(value) for letter, value in _VALUE.findall(match[1])},
        steps={letter: int(value) for letter, value in _VALUE.findall(match[2])},
    )


def parse_setting(text: str) -> tuple[str, dict[str, float]] | None:
    """Return code and values of a line of ``M503``, as (M92, {X: 80.0}); None for another line."""
    match = _SETTING.fullmatch(text.strip())
    if match is None:
        return None
    return match[1], {letter: float(value) for letter, value in _WORD.findall(match[2])}


def parse_name(text: str) -> str:
    """Return name and version of an answer to ``M115``, '' for another line."""
    match = _NAME.search(text)
    return match[1] if match else ''
