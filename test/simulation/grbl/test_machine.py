# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import pytest

from ivfmc_ros.devices.motion import trajectory
from ivfmc_ros.simulation.grbl.machine import GrblMachine


class Bench:
    """A machine with a simulated clock."""

    def __init__(self, **settings):
        self.now = 100.0
        self.motions, self.outputs = [], []
        self.machine = GrblMachine(
            on_motion=lambda now, motion: self.motions.append(motion),
            on_outputs=lambda now, outputs: self.outputs.append((now, outputs)),
        )
        self.machine.settings.update({int(key[1:]): value for key, value in settings.items()})
        self.machine.power_on(self.now)
        self.banner = self.machine.take_output().decode()

    def send(self, text, seconds=0.0):
        self.machine.feed(text.encode('latin-1'), self.now)
        return self.wait(seconds)

    def wait(self, seconds=0.0):
        end = self.now + seconds
        while self.now < end:
            self.now = min(self.now + 0.001, end)
            self.machine.advance(self.now)
        return self.machine.take_output().decode()

    def lines(self, text, seconds=0.0):
        return self.send(text, seconds).split('\r\n')[:-1]


def test_power_on_sends_the_banner():
    assert Bench().banner == "\r\nGrbl 1.1h ['$' for help]\r\n"


def test_each_line_has_one_response():
    bench = Bench()
    assert bench.lines('G21G90G94\n\n(comment)\n; more\nG1 F600\n') == ['ok'] * 5


# responses of GRBL 1.1h of 2019-08-30, built from its sources for a computer
@pytest.mark.parametrize(
    ('line', 'answer'),
    [
        ('foo', 'error:2'),
        ('X', 'error:2'),
        ('G1X1X2', 'error:25'),
        ('G0G1', 'error:24'),
        ('M3M5', 'error:21'),
        ('G4', 'error:28'),
        ('G4P0.01', None),
        ('G99', 'error:20'),
        ('M1', 'ok'),
        ('M3.5', 'error:23'),
        ('G1X1', 'error:22'),
        ('G1X1F-1', 'error:4'),
        ('$H', 'error:5'),
        ('$Q', 'error:2'),
        ('$999=1', 'error:3'),
        ('$20', 'error:3'),
        ('$120=-1', 'error:4'),
        ('$120=50', 'ok'),
        ('A' * 100, 'error:11'),
    ],
)
def test_answers_are_those_of_grbl(line, answer):
    assert Bench().lines(f'{line}\n') == ([] if answer is None else [answer])


def test_reports_have_offsets_then_overrides_then_neither():
    bench = Bench()
    position = '<Idle|MPos:0.000,0.000,0.000|FS:0,0'
    assert bench.lines('?') == [f'{position}|WCO:0.000,0.000,0.000>']
    assert bench.lines('?') == [f'{position}|Ov:100,100,100>']
    assert bench.lines('?') == [f'{position}>']


def test_move_takes_the_time_of_its_ramp():
    bench = Bench()
    assert bench.lines('G1X10F600\n') == ['ok']
    motion = bench.motions[-1]
    assert trajectory.end_time(motion) - bench.now == pytest.approx(1.0 + 10 / 360, abs=1e-6)
    assert bench.lines('?')[0].startswith('<Run|MPos:0.000')
    bench.wait(0.5)
    assert '|FS:600,' in bench.lines('?')[0]
    bench.wait(0.6)
    assert bench.lines('?')[0].startswith('<Idle|MPos:10.000')


def test_targets_are_whole_steps():
    bench = Bench(s100=10.0)
    bench.send('G1X1.234F6000\n', 1.0)
    assert bench.lines('?')[0].startswith('<Idle|MPos:1.200')


def test_response_to_a_dwell_comes_after_the_motion():
    bench = Bench()
    bench.send('G1X10F600\n')
    assert bench.send('G4P0.01\n', 0.9) == ''
    assert bench.wait(0.2) == 'ok\r\n'


@pytest.mark.parametrize(('line', 'lit'), [('M3S500', (0.5, 0.0)), ('M8', (0.0, 1.0))])
def test_outputs_switch_after_the_motion_also_off(line, lit):
    bench = Bench()
    bench.send('G1X10F600\n')
    assert bench.send(f'{line}\n', 0.9) == ''
    assert bench.outputs == []
    assert bench.wait(0.2) == 'ok\r\n'
    [(_, outputs)] = bench.outputs
    assert (outputs.spindle, outputs.coolant) == lit
    bench.send('G1X20\nM5\nM9\n', 0.9)
    assert len(bench.outputs) == 1
    bench.wait(0.3)
    assert (bench.outputs[-1][1].spindle, bench.outputs[-1][1].coolant) == (0.0, 0.0)


def test_in_laser_mode_m4_is_off_at_standstill_and_m3_is_on():
    bench = Bench(s32=1.0)
    bench.send('G1F600\nM4S1000\n')
    assert bench.outputs == []
    bench.send('X10\n', 0.5)
    assert bench.outputs[-1][1].spindle == 1.0
    bench.wait(1.0)
    assert bench.outputs[-1][1].spindle == 0.0
    bench.send('M3\n')
    assert bench.outputs[-1][1].spindle == 1.0


def test_hold_brakes_and_resume_continues():
    bench = Bench()
    bench.send('G1X10F600\n', 0.5)
    bench.send('!')
    assert bench.lines('?')[0].startswith('<Hold:1|')
    bench.wait(0.1)
    held = bench.lines('?')[0]
    assert held.startswith('<Hold:0|MPos:5.0')
    bench.wait(1.0)
    assert bench.lines('?')[0].split('|')[1] == held.split('|')[1]
    assert bench.send('G1X0\n') == ''
    bench.send('~', 3.0)
    assert bench.lines('?')[0].startswith('<Idle|MPos:0.000')


def test_reset_after_a_hold_keeps_the_position_and_turns_outputs_off():
    bench = Bench()
    bench.send('M8\nG1X10F600\n', 0.5)
    bench.send('!', 0.2)
    position = bench.lines('?')[0].split('|')[1]
    assert bench.send('\x18') == "\r\nGrbl 1.1h ['$' for help]\r\n"
    assert bench.outputs[-1][1].coolant == 0.0
    assert bench.lines('?')[0].startswith(f'<Idle|{position}')


def test_reset_while_moving_is_alarm_3():
    bench = Bench()
    bench.send('G1X10F600\n', 0.5)
    assert bench.lines('\x18')[0] == 'ALARM:3'
    assert bench.lines('G1X1F600\n') == ['error:9']
    assert bench.lines('$X\n') == ['[MSG:Caution: Unlocked]', 'ok']
    assert bench.lines('G1X1F600\n') == ['ok']


def test_no_reports_after_a_limit_switch_until_a_reset():
    bench = Bench()
    bench.machine.alarm(1, bench.now)
    assert bench.wait() == 'ALARM:1\r\n[MSG:Reset to continue]\r\n'
    assert bench.send('?$X\n') == ''
    assert 'Grbl' in bench.send('\x18')


def test_power_on_makes_the_present_position_zero():
    bench = Bench()
    bench.send('G1X10F6000\n', 2.0)
    bench.machine.power_on(bench.now)
    bench.wait()
    assert bench.lines('?')[0].startswith('<Idle|MPos:0.000')
    assert bench.motions[-1][-1].position == pytest.approx(10.0)


def test_homing_responds_when_it_has_ended():
    bench = Bench(s22=1.0, s25=36000.0)
    assert 'unlock' in bench.banner
    assert bench.lines('G1X1F100\n') == ['error:9']
    assert bench.send('$H\n') == ''
    assert bench.send('?', 1.0) == ''
    answers = bench.wait(10.0).split('\r\n')
    assert answers[0].startswith('<Idle|MPos:-1.000')
    assert answers[1] == 'ok'
    assert bench.motions[-1][-1].position == pytest.approx(359.0)


def test_settings_are_refused_while_moving():
    bench = Bench()
    bench.send('G1X10F600\n', 0.1)
    assert bench.lines('$120=50\n$$\n') == ['error:8', 'error:8']
