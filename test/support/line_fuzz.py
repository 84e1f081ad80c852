# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Random and damaged lines for the parsers of motion controllers, and what must hold for each."""

from collections.abc import Callable
import math
from random import Random
import re
import time

from hypothesis import HealthCheck
from hypothesis import Phase
from hypothesis import settings
from hypothesis import strategies as st

from ivfmc_ros.devices import detection
from ivfmc_ros.devices.grbl import protocol as grbl
from ivfmc_ros.devices.marlin import protocol as marlin
from ivfmc_ros.devices.settings import FIRMWARES
from ivfmc_ros.devices.unknown_lines import UnknownLines

SIGNS = '0123456789.:,|<>-$= '
LINES_PER_EXAMPLE, TEXTS = 1000, 20
# Seconds of one line; a parser whose expressions backtrack takes minutes for some.
LINE_S = 0.2
# What the firmwares send, to be damaged.
GOOD = (
    'ok',
    'error:9',
    'error: Bad number format',
    'ALARM:3',
    'ALARM: Hard/soft limit',
    "Grbl 1.1h ['$' for help]",
    "GrblHAL 1.1f ['$' or '$HELP' for help]",
    "Grbl 3.7 [FluidNC v3.7.16 (wifi) '$' for help]",
    "Horus 0.2 ['$' for help]",
    '<Idle|MPos:0.000,-12.345,0.000|Bf:100,1023|FS:0,0|Ov:100,100,100|A:SF|TLR:0>',
    '<Hold:0|WPos:1.0000,2.0000,3.0000,4.000|WCO:0.0000,0.0000,0.0000,0.000>',
    '<Run,MPos:1.000,2.000,3.000,WPos:1.000,2.000,3.000>',
    '$110=500.000 (x max rate, mm/min)',
    '$/axes/a/max_rate_mm_per_min=1000.000',
    '[AXS:4:XYZA]',
    '[MSG:INFO: Connected]',
    'start',
    'ok P15 B3',
    'echo:busy: processing',
    'Error:Printer halted. kill() called!',
    'X:10.00 Y:0.00 Z:0.00 E:0.00 Count X:1600 Y:0 Z:0',
    'echo:  M203 X300.00 Y300.00 Z5.00 E25.00',
    'FIRMWARE_NAME:Marlin 2.1.2 SOURCE_CODE_URL:x',
    'M200',
    '2.0.5',
    '>',
)


def damaged(random: Random) -> str:
    """Return a line that lost bytes, got others, was cut off, or joined with another one."""
    text = random.choice(GOOD)
    for _ in range(random.randrange(4)):
        at = random.randrange(len(text) + 1)
        text = random.choice(
            (
                text[:at] + text[at + 1 :],
                text[:at] + chr(random.randrange(256)) + text[at:],
                text[:at] + random.choice(GOOD) + text[at:],
                text[:at]
                + random.choice('0123456789.:,|<>-$= ') * random.randrange(9)
                + text[at:],
                text[:at],
            )
        )
    return text


@st.composite
def lines(draw: st.DrawFn) -> list[str]:
    """Draw damaged lines, and some that have nothing to do with a controller."""
    random = Random(draw(st.integers(0, 2**32)))
    texts = draw(st.lists(st.text(max_size=99), min_size=TEXTS, max_size=TEXTS))
    return [*texts, *(damaged(random) for _ in range(LINES_PER_EXAMPLE - TEXTS))]


def check_grbl(text: str) -> None:
    """No exception, no ok but ``ok``, and only finite positions."""
    line = grbl.parse(text)
    if isinstance(line, grbl.Response) and line.error is None:
        assert text == 'ok', ascii(text)
    if isinstance(line, grbl.StatusReport):
        values = [*(line.machine or ()), *(line.work or ()), *(line.offset or ())]
        assert all(math.isfinite(value) for value in values), ascii(text)
        assert line.state in grbl.STATES
    if isinstance(line, grbl.Alarm):
        grbl.describe_alarm(grbl.name_alarm(line))


def check_marlin(text: str) -> None:
    """No exception, no end of an answer but ``ok``, and only finite positions."""
    if marlin.is_end(text):
        assert re.match(r'ok( |$)', text), ascii(text)
    position = marlin.parse_position(text)
    if position is not None:
        assert all(math.isfinite(value) for value in position.commanded.values())
    marlin.parse_setting(text)
    marlin.parse_name(text)
    marlin.is_understood(text)


def check_detection(text: str) -> None:
    """No exception, and a known firmware or none."""
    found = detection.recognize(text.encode('utf-8', 'replace'))
    assert found in ('', *FIRMWARES[1:])
    detection.describe(text.encode('utf-8', 'replace'))


def check_unknown_lines(text: str) -> None:
    """No exception, and a kind that can be logged."""
    lines = UnknownLines()
    lines.add(text)
    assert all(kind.isascii() and kind.isprintable() for kind in lines.counts())


CHECKS: dict[str, Callable[[str], None]] = {
    'GRBL family': check_grbl,
    'Marlin': check_marlin,
    'detection': check_detection,
    'unknown lines': check_unknown_lines,
}


def check_all(check: Callable[[str], None], texts: list[str]) -> None:
    """Check each line, and that none takes long."""
    for text in texts:
        start = time.process_time()
        check(text)
        assert time.process_time() - start < LINE_S, ascii(text)


def fuzz_settings(number: int) -> settings:
    """Settings of hypothesis for a number of lines; the lines are the same each time."""
    return settings(
        max_examples=max(number // LINES_PER_EXAMPLE, 1),
        deadline=None,
        derandomize=True,
        database=None,
        suppress_health_check=list(HealthCheck),
        phases=(Phase.generate,),
    )
