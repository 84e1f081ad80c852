# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import math

import pytest

from ivfmc_ros.devices.grbl.protocol import Alarm
from ivfmc_ros.devices.grbl.protocol import Banner
from ivfmc_ros.devices.grbl.protocol import Feedback
from ivfmc_ros.devices.grbl.protocol import parse
from ivfmc_ros.devices.grbl.protocol import Response
from ivfmc_ros.devices.grbl.protocol import Setting
from ivfmc_ros.devices.grbl.protocol import StatusReport
from ivfmc_ros.devices.grbl.protocol import UNNUMBERED

MM = (3, 3, 3)


@pytest.mark.parametrize(
    ('text', 'line'),
    [
        ('ok', Response()),
        ('error:9', Response(error=9)),
        ('ALARM:3', Alarm(number=3)),
        ("Grbl 1.1h ['$' for help]", Banner(version='1.1h', firmware='Grbl')),
        ("Grbl 0.9j ['$' for help]", Banner(version='0.9j', firmware='Grbl')),
        ("GrblHAL 1.1f ['$' or '$HELP' for help]", Banner(version='1.1f', firmware='grblHAL')),
        (
            "Grbl 3.6 [FluidNC v3.6.5 (wifi) '$' for help]",
            Banner(version='3.6', firmware='FluidNC'),
        ),
        # bytes of it were lost: the controller has started all the same
        ("Gbl 1.1h ['$' for help]", Banner(version='1.1h')),
        ("Grbl 1.1h ['$' for elp]", Banner(version='1.1h', firmware='Grbl')),
        ('Grbl', Banner(version='', firmware='Grbl')),
        ("rbl 1h ['$' for help]", Banner(version='')),
        ("Horus 0.2 ['$' for help]", Banner(version='0.2', firmware='Horus')),
        ('error: Bad number format', Response(error=2, text='Bad number format')),
        ('error: Invalid gcode ID:24', Response(error=24, text='Invalid gcode ID:24')),
        ('error: Alarm from Mars', Response(error=UNNUMBERED, text='Alarm from Mars')),
        ('ALARM: Abort during cycle', Alarm(number=3)),
        ('ALARM: Something new', Alarm(number=UNNUMBERED)),
        ('$120=360.000', Setting(key='120', value=360.0)),
        ('$32=0 (laser mode, bool)', Setting(key='32', value=0.0)),
        ('$100=250.00000', Setting(key='100', value=250.0)),
        (
            '$/axes/a/max_rate_mm_per_min=800.0',
            Setting(key='/axes/a/max_rate_mm_per_min', value=800.0),
        ),
        ('$/report_inches=false', Setting(key='/report_inches', value=0.0)),
        ("[MSG:'$H'|'$X' to unlock]", Feedback(key='MSG', value="'$H'|'$X' to unlock")),
        ('[AXS:4:XYZA]', Feedback(key='AXS', value='4:XYZA')),
        ('[0.9j.20160726:]', Feedback(key='0.9j.20160726', value='')),
        ('[echo G1X1]', Feedback(key='', value='echo G1X1')),
        (
            '[MSG:INFO: Connecting to STA SSID:x]',
            Feedback(key='MSG', value='INFO: Connecting to STA SSID:x'),
        ),
        (
            '<Idle|MPos:1.000,0.000,-2.500|FS:0,0|WCO:0.000,1.000,0.000>',
            StatusReport(
                state='Idle',
                machine=(1.0, 0.0, -2.5),
                offset=(0.0, 1.0, 0.0),
                decimals=MM,
                pins='',
            ),
        ),
        (
            '<Hold:1|WPos:1.000,0.000,0.000|Bf:15,128|Ov:100,100,100|A:SF>',
            StatusReport(
                state='Hold',
                substate=1,
                work=(1.0, 0.0, 0.0),
                outputs='SF',
                decimals=MM,
                pins='',
            ),
        ),
        (
            '<Run|MPos:4.572,0.000,0.000|FS:153,0|Pn:PXYZRHS|Ov:100,100,100>',
            StatusReport(
                state='Run',
                machine=(4.572, 0.0, 0.0),
                outputs='',
                decimals=MM,
                pins='PXYZRHS',
            ),
        ),
        (
            '<Idle|MPos:4.5720,0.0000,0.0000|FS:0,0>',
            StatusReport(state='Idle', machine=(4.572, 0.0, 0.0), decimals=(4, 4, 4), pins=''),
        ),
        # grblHAL of August 2026, FluidNC with a rotary axis and inches, GRBL 0.9j, Horus
        (
            '<Idle|MPos:0.000,0.000,0.000|Bf:100,1023|FS:0,0|Ov:100,100,100|A:|TLR:0>',
            StatusReport(state='Idle', machine=(0.0, 0.0, 0.0), outputs='', decimals=MM, pins=''),
        ),
        (
            '<Tool|MPos:0.000,0.000,0.000|WCS:G54|A:ST|Sc:|MPG:0|H:0|T:0|P:0|FW:grblHAL>',
            StatusReport(
                state='Tool', machine=(0.0, 0.0, 0.0), outputs='ST', decimals=MM, pins=''
            ),
        ),
        (
            '<Run|MPos:0.0000,0.0000,0.0000,90.000|FS:1,0>',
            StatusReport(
                state='Run', machine=(0.0, 0.0, 0.0, 90.0), decimals=(4, 4, 4, 3), pins=''
            ),
        ),
        (
            '<Hold,MPos:0.036,0.000,0.000,WPos:0.036,0.000,0.000>',
            StatusReport(
                state='Hold', machine=(0.036, 0.0, 0.0), work=(0.036, 0.0, 0.0), decimals=MM
            ),
        ),
        (
            '<Queue,MPos:5.000,0.000,0.000,Buf:1,RX:0>',
            StatusReport(state='Queue', machine=(5.0, 0.0, 0.0), decimals=MM),
        ),
    ],
)
def test_lines_of_grbl_are_parsed(text, line):
    assert parse(text) == line


@pytest.mark.parametrize('field', ['P:X', 'n:X', 'PnX', 'P:XYZ', 'nX', '0,0Pn:X'])
def test_pins_of_a_damaged_field_are_unknown(field):
    report = parse(f'<Run|MPos:0.000,0.000,0.000|FS:0,0|T:1|{field}>')
    assert report is None or report.pins is None


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
        # a byte of a number was lost
        '<Idle|MPos:12.00,0.000,0.000>',
        '<Idle|MPos:12000,0.000,0.000>',
        '<Idle|MPos:12.000,0.000,0.000|WCO:0.0000,0.0000,0.0000>',
        '<Idle|MPos:1_2.000,0.000,0.000>',
        '$120',
        '\ufffd\ufffd',
    ],
)
def test_damaged_lines_are_rejected(text):
    assert parse(text) is None


@pytest.mark.parametrize('text', ['$110=.000', '$110=500.000ok', '$110=5.00.000', '$70=Grbl'])
def test_value_of_a_setting_that_is_no_number_is_nan(text):
    line = parse(text)
    assert isinstance(line, Setting)
    assert math.isnan(line.value)
