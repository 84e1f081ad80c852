# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Finds out which firmware a motion controller runs, by what it says at its start or when asked.

The port stays open: opening it again would reset many controllers once more.
"""

from collections.abc import Sequence
from dataclasses import dataclass
import re
import time

import serial

from ivfmc_ros.devices.serial_line import open_port
from ivfmc_ros.errors import ControllerLostError

# A boot loader listens for two seconds before it starts the firmware.
_GREETING_S = 2.5
# Seconds in which a running firmware answers a question.
_ANSWER_S = 0.8
_PERIOD_S = 0.02  # between looks at the port
_MAX_RECEIVED = 8192  # bytes; more is noise
_MAX_LINES_SHOWN, _MAX_SHOWN = 3, 60  # lines, and characters of each, of an unknown greeting

# What tells a firmware: of its greeting, or of its answer to one of the questions.
_MARKS = (
    (re.compile(rb'FluidNC'), 'fluidnc'),
    (re.compile(rb'GrblHAL|grblHAL'), 'grblhal'),
    (re.compile(rb'Horus \d'), 'horus'),
    # of the GRBL family: a damaged banner, or a status report
    (re.compile(rb'Grbl \d|for help\]|<(Idle|Alarm|Run|Hold|Door|Check|Home|Sleep)'), 'grbl'),
    (re.compile(rb'FIRMWARE_NAME:|echo:Marlin|Marlin \d'), 'marlin'),
    # echo of a line, then the version, then the prompt
    (re.compile(rb'M200[;\s]+[^\n>]*\d[^\n>]*\n(?s:.)*>'), 'fabscan'),
)
# In this order: a question that another firmware takes for a command would do harm. ``?`` is a
# real-time byte of GRBL and the begin of an unknown command elsewhere, M115 is a question to
# Marlin, M200 one to FabScan and (asked last) the volumetric mode of Marlin.
_QUESTIONS = (b'?', b'\nM115\n', b'\nM200\n')


@dataclass(frozen=True, kw_only=True)
class OpenPort:
    """
    A port that is open, and what was received from it.

    firmware : one of ``settings.FIRMWARES``, never auto
    """

    firmware: str
    port: serial.Serial
    received: bytes


def detect(name: str, baud: int) -> OpenPort:
    """
    Open a port and find out the firmware behind it.

    name : device file or pyserial URL
    :raises ControllerLostError: the port cannot be opened, or no known firmware answers
    """
    port = open_port(name, baud)
    try:
        received = _listen(port, b'', _GREETING_S)
        for question in _QUESTIONS:
            if firmware := recognize(received):
                return OpenPort(firmware=firmware, port=port, received=received)
            port.write(question)
            received = _listen(port, received, _ANSWER_S)
        if firmware := recognize(received):
            return OpenPort(firmware=firmware, port=port, received=received)
    except OSError as error:
        port.close()
        raise ControllerLostError(f'port {name}: {error}') from error
    port.close()
    raise ControllerLostError(f'port {name}: no known firmware answers; {describe(received)}')


def recognize(received: bytes) -> str:
    """Return the firmware that sent these bytes, '' if it is not known (yet)."""
    return next((firmware for mark, firmware in _MARKS if mark.search(received)), '')


def describe(received: bytes) -> str:
    """Return what was received, for an error message."""
    lines = [line for line in received.decode('ascii', 'replace').split('\n') if line.strip()]
    if not lines:
        return 'nothing was received; check port, baud rate and power'
    return f'received: {_shown(lines)}; check firmware and baud rate'


def _shown(lines: Sequence[str]) -> str:
    return ', '.join(ascii(line.strip()[:_MAX_SHOWN]) for line in lines[:_MAX_LINES_SHOWN])


def _listen(port: serial.Serial, received: bytes, seconds: float) -> bytes:
    """Return all that was received when a firmware is recognized, or the time has passed."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        data = port.read(max(1, port.in_waiting))
        received = (received + data)[-_MAX_RECEIVED:]
        # a banner whose end has not come yet may name another firmware
        if received.endswith((b'\n', b'>')) and recognize(received):
            return received
        if not data:
            time.sleep(_PERIOD_S)
    return received
