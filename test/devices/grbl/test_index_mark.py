# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The index mark of an emulated controller, whose reports are read at 8 Hz with jitter."""

import math

import numpy as np
import pytest

from ivfmc_ros.devices.grbl.index_mark import IndexMark
from ivfmc_ros.devices.grbl.protocol import parse
from ivfmc_ros.simulation.grbl.machine import GrblMachine

# Seconds from one report to the next while the table moves, and their jitter.
PERIOD_S, JITTER_S = 0.125, 0.02
# Degrees a second: a sweep of 200 profiles at 15 images a second, and one for 0.6 degrees.
SWEEP, SLOW = 27.0, 3.0


class Turning:
    """A table that turns, its mark of 30 degrees, and the reports of it."""

    def __init__(self, speed, seed=0):
        self.machine = GrblMachine(
            on_motion=lambda now, motion: None, on_outputs=lambda now, outputs: None
        )
        self.machine.index_mark = ('X', 100.0, 130.0)
        self.rng, self.now, self.speed = np.random.default_rng(seed), 100.0, speed
        self.mark = IndexMark(360.0)
        self.machine.power_on(self.now)
        self.machine.take_output()
        self.target = 0.0

    def turn(self, turns, damage=0.0):
        """Turn on; each report loses a byte with the probability ``damage``."""
        self.target += 360.0 * turns
        # in pieces, because the driver may do so too
        self.machine.feed(f'G1 X{self.target:.3f} F{60 * self.speed:.1f}\n'.encode(), self.now)
        self.now += 0.01
        self.machine.take_output()
        while self.machine.axis.state != 'Idle':
            self.now += PERIOD_S + self.rng.uniform(-JITTER_S, JITTER_S)
            self.machine.advance(self.now)
            self.report(damage)

    def report(self, damage):
        self.machine.feed(b'?', self.now)
        text = self.machine.take_output().decode().strip().splitlines()[-1]
        if self.rng.uniform() < damage:
            lost = int(self.rng.integers(len(text)))
            text = text[:lost] + text[lost + 1 :]
        report = parse(text)
        # the tracker of the axis leaves out positions off the plan
        off = math.inf if report is None else abs(report.machine[0] - self.position())
        if off < 0.05 and report.pins is not None:
            self.mark.update(report.machine[0], 'X' in report.pins)

    def position(self):
        return self.machine.axis.state_at(self.now)[0]


def test_reports_of_50_turns_with_jitter_give_no_false_alarm():
    table = Turning(SWEEP)
    table.turn(50)
    assert table.mark.slip is None
    assert table.mark.passes == 100
    assert 'passed 100 times' in table.mark.text


def test_damaged_reports_give_no_false_alarm():
    table = Turning(SWEEP, seed=1)
    table.turn(50, damage=0.05)
    assert table.mark.slip is None
    assert table.mark.passes > 80


@pytest.mark.parametrize('seed', range(5))
@pytest.mark.parametrize(('speed', 'slip'), [(SWEEP, 5.0), (SWEEP, -5.0), (SLOW, 0.6)])
def test_slip_beyond_the_resolution_is_found_in_the_next_turn(speed, slip, seed):
    table = Turning(speed, seed)
    table.turn(6)
    assert table.mark.slip is None
    table.machine.axis.slip(slip, table.now)
    table.turn(1)
    low, high = table.mark.slip
    # a table that is ahead of the motor reaches its mark early
    assert low <= -slip <= high
    assert table.mark.text.endswith('the table slipped')
    assert (slip > 0) == ('early' in table.mark.text)


def test_slip_below_the_resolution_is_not_found():
    # 3.4 degrees from report to report: it must not be said that 0.6 degrees would be seen
    table = Turning(SWEEP)
    table.turn(6)
    table.machine.axis.slip(0.6, table.now)
    table.turn(1)
    assert table.mark.slip is None
    assert 'known within' in table.mark.text


def test_mark_is_known_anew_after_the_position_was_accepted():
    table = Turning(SWEEP)
    table.turn(3)
    table.machine.axis.slip(20.0, table.now)
    table.mark.reset()
    table.turn(3)
    assert table.mark.slip is None


def test_mark_that_is_passed_in_both_directions_has_two_places():
    # a switch has a hysteresis
    mark = IndexMark(360.0)
    for turn in range(3):
        for degrees in range(0, 200, 2):
            mark.update(360.0 * turn + degrees, degrees >= 100)
        for degrees in range(200, -160, -2):
            mark.update(360.0 * turn + degrees, degrees % 360 > 80)
    assert mark.slip is None


@pytest.mark.parametrize(
    ('text', 'pins'),
    [
        ('<Run|MPos:1.000,0.000,0.000|FS:1,0|Pn:XP|Ov:100,100,100>', 'XP'),
        ('<Run|MPos:1.000,0.000,0.000|FS:1,0>', ''),
        ('<Run|MPos:1.000,0.000,0.000|FS:1,0|P:X>', None),
        ('<Run|MPos:1.000,0.000,0.000|FS:1,0|Pn:>', None),
        ('<Run|MPos:1.000,0.000,0.000|FS:1,0|PnX>', None),
        ('<Run|MPos:1.000,0.000,0.000|FS:1,0Pn:X>', None),
        ('<Run,MPos:1.000,0.000,0.000,WPos:1.000,0.000,0.000>', None),
    ],
)
def test_pins_of_a_damaged_report_are_not_known(text, pins):
    assert parse(text).pins == pins
