# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import pytest

from ivfmc_ros.devices.grbl.protocol import Alarm
from ivfmc_ros.devices.grbl.protocol import Answer
from ivfmc_ros.devices.grbl.protocol import Banner
from ivfmc_ros.devices.grbl.protocol import Message
from ivfmc_ros.devices.grbl.protocol import parse
from ivfmc_ros.devices.grbl.protocol import Report
from ivfmc_ros.devices.grbl.protocol import Setting


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('ok', Answer()),
        ('error:9', Answer(error=9)),
        ('ALARM:3', Alarm(number=3)),
        ("Grbl 1.1h ['$' for help]", Banner(version='1.1h')),
        ('$120=360.000', Setting(number=120, value=360.0)),
        ('$32=0 (laser mode, bool)', Setting(number=32, value=0.0)),
        ("[MSG:'$H'|'$X' to unlock]", Message(text="MSG:'$H'|'$X' to unlock")),
        (
            '<Idle|MPos:1.000,0.000,-2.500|FS:0,0|WCO:0.000,1.000,0.000>',
            Report(state='Idle', machine=(1.0, 0.0, -2.5), offset=(0.0, 1.0, 0.0)),
        ),
        (
            '<Hold:1|WPos:1.000,0.000,0.000|Bf:15,128|Ov:100,100,100|A:SF>',
            Report(state='Hold', substate=1, work=(1.0, 0.0, 0.0), outputs='SF'),
        ),
        (
            '<Run|MPos:4.572,0.000,0.000|FS:153,0|Pn:PXYZRHS|Ov:100,100,100>',
            Report(state='Run', machine=(4.572, 0.0, 0.0), outputs=''),
        ),
    ],
)
def test_what_a_board_says(text, said):
    assert parse(text) == said


@pytest.mark.parametrize(
    'text',
    [
        '',
        'o',
        'okk',
        'rror:9',
        'error:',
        'ALARM:x',
        'Grbl',
        '<Idle|MPos:1.000,0.000',
        '<Idl|MPos:1.000,0.000,0.000>',
        '<Idle|MPos:1.0.00,0.000,0.000>',
        '<Idle|MPos:nan,0.000,0.000>',
        '<Idle|FS:0,0>',
        '<Hold:x|MPos:1.000,0.000,0.000>',
        '$120',
        '\ufffd\ufffd',
    ],
)
def test_garbled_lines_say_nothing(text):
    assert parse(text) is None
