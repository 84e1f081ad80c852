# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import pytest

from ivfmc_ros.devices.grbl.protocol import Alarm
from ivfmc_ros.devices.grbl.protocol import Banner
from ivfmc_ros.devices.grbl.protocol import Feedback
from ivfmc_ros.devices.grbl.protocol import parse
from ivfmc_ros.devices.grbl.protocol import Response
from ivfmc_ros.devices.grbl.protocol import Setting
from ivfmc_ros.devices.grbl.protocol import StatusReport


@pytest.mark.parametrize(
    ('text', 'line'),
    [
        ('ok', Response()),
        ('error:9', Response(error=9)),
        ('ALARM:3', Alarm(number=3)),
        ("Grbl 1.1h ['$' for help]", Banner(version='1.1h')),
        ("Grbl 0.9j ['$' for help]", Banner(version='0.9j')),
        ("GrblHAL 1.1f ['$' or '$HELP' for help]", Banner(version='1.1f')),
        ("Grbl 3.6 [FluidNC v3.6.5 (wifi) '$' for help]", Banner(version='3.6')),
        # bytes of it were lost: the controller has started all the same
        ("Gbl 1.1h ['$' for help]", Banner(version='1.1h')),
        ("Grbl 1.1h ['$' for elp]", Banner(version='1.1h')),
        ('Grbl', Banner(version='')),
        ("rbl 1h ['$' for help]", Banner(version='')),
        ('$120=360.000', Setting(number=120, value=360.0)),
        ('$32=0 (laser mode, bool)', Setting(number=32, value=0.0)),
        ("[MSG:'$H'|'$X' to unlock]", Feedback(text="MSG:'$H'|'$X' to unlock")),
        (
            '<Idle|MPos:1.000,0.000,-2.500|FS:0,0|WCO:0.000,1.000,0.000>',
            StatusReport(state='Idle', machine=(1.0, 0.0, -2.5), offset=(0.0, 1.0, 0.0)),
        ),
        (
            '<Hold:1|WPos:1.000,0.000,0.000|Bf:15,128|Ov:100,100,100|A:SF>',
            StatusReport(state='Hold', substate=1, work=(1.0, 0.0, 0.0), outputs='SF'),
        ),
        (
            '<Run|MPos:4.572,0.000,0.000|FS:153,0|Pn:PXYZRHS|Ov:100,100,100>',
            StatusReport(state='Run', machine=(4.572, 0.0, 0.0), outputs=''),
        ),
        (
            '<Idle|MPos:4.5720,0.0000,0.0000|FS:0,0>',
            StatusReport(state='Idle', machine=(4.572, 0.0, 0.0), inches=True),
        ),
    ],
)
def test_lines_of_grbl_are_parsed(text, line):
    assert parse(text) == line


@pytest.mark.parametrize(
    'text',
    [
        '',
        'o',
        'okk',
        'rror:9',
        'error:',
        'ALARM:x',
        '<Idle|MPos:1.000,0.000',
        '<Idl|MPos:1.000,0.000,0.000>',
        '<Idle|MPos:1.0.00,0.000,0.000>',
        '<Idle|MPos:nan,0.000,0.000>',
        '<Idle|FS:0,0>',
        '<Hold:x|MPos:1.000,0.000,0.000>',
        '<Hold:|MPos:1.000,0.000,0.000>',
        # a line end was lost between two reports, or between a report and a response
        '<Idle|MPos:0.000,0.000,0.000|FS:0,0><Run|MPos:123.000,0.000,0.000|FS:0,0>',
        '<Idle|MPos:0.000,0.000,0.000|FS:0,0<Run|MPos:123.000,0.000,0.000|FS:0,0>',
        '<Idle|MPos:0.000,0.000,0.000|FS:0,0ok|MPos:123.000,0.000,0.000>',
        'ok<Idle|MPos:0.000,0.000,0.000|FS:0,0>',
        'okok',
        'ok$110=500.000',
        '$110=500.000$111=500.000',
        '$110=500.000ok',
        # a byte of a number was lost
        '<Idle|MPos:12.00,0.000,0.000>',
        '<Idle|MPos:12000,0.000,0.000>',
        '<Idle|MPos:12.0000,0.000,0.000>',
        '<Idle|MPos:12.000,0.000,0.000|WCO:0.0000,0.0000,0.0000>',
        '<Idle|MPos:1_2.000,0.000,0.000>',
        '$110=500.00',
        '$110=.000',
        '$120',
        '\ufffd\ufffd',
    ],
)
def test_damaged_lines_are_rejected(text):
    assert parse(text) is None
