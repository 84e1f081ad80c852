# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import random

import pytest

from ivfmc_ros.errors import ClockJumpError
from ivfmc_ros.scan.clock_monitor import ClockMonitor

START_S = 1_700_000_000.0


class Clocks:
    steady_s = 100.0
    wall_change_s = 0.0

    def steady(self):
        return self.steady_s

    def wall(self):
        return START_S + self.steady_s + self.wall_change_s


def monitored(change_s, latency=lambda _: 0.003, seconds=6.0, drift=0.0):
    """Receive joint_states at 50 Hz whose clock jumps by ``change_s`` in the middle."""
    clocks = Clocks()
    monitor = ClockMonitor(clocks.steady, clocks.wall)
    count = int(seconds * 50)
    for number in range(count):
        sent_s = 100.0 + number / 50
        clocks.steady_s = max(clocks.steady_s, sent_s + latency(number))
        stamp_s = START_S + sent_s * (1.0 + drift) + (change_s if number > count // 2 else 0.0)
        monitor.add('joint_states', round(stamp_s * 1e9))
    return monitor


@pytest.mark.parametrize('change_s', [-3600.0, -1.0, -0.3, -0.06, 1.0, 3600.0])
def test_jump_of_the_stamps_is_a_fault_of_the_scan(change_s):
    direction = 'forward' if change_s > 0 else 'back'
    with pytest.raises(ClockJumpError, match=f'joint_states jumped {direction}') as caught:
        monitored(change_s).require_no_jump()
    assert caught.value.code == 'CLOCK_JUMPED'


def test_loaded_receiver_is_no_jump():
    rng = random.Random(1)
    monitored(0.0, lambda _: rng.expovariate(1 / 0.05)).require_no_jump()


def test_receiver_that_was_stopped_for_seconds_is_no_jump():
    monitored(0.0, lambda number: 3.0 if 100 < number < 250 else 0.003).require_no_jump()


def test_first_messages_that_are_received_late_are_no_jump():
    monitored(0.0, lambda number: 2.0 if number < 20 else 0.003).require_no_jump()


@pytest.mark.parametrize('drift', [-5e-4, 5e-4])
def test_slewed_clock_is_no_jump(drift):
    monitored(0.0, seconds=2000.0, drift=drift).require_no_jump()


@pytest.mark.parametrize('change_s', [-3600.0, -0.2, 0.2, 3600.0])
def test_jump_of_the_own_clock_is_a_fault_of_the_scan(change_s):
    clocks = Clocks()
    monitor = ClockMonitor(clocks.steady, clocks.wall)
    for _ in range(10):
        monitor.check_own_clock()
        clocks.steady_s += 0.1
    monitor.require_no_jump()
    clocks.wall_change_s += change_s
    monitor.check_own_clock()
    with pytest.raises(ClockJumpError, match='the clock of this computer'):
        monitor.require_no_jump()


def test_new_scan_forgets_the_jump_before_it():
    monitor = monitored(-3600.0)
    monitor.reset()
    monitor.require_no_jump()
