# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import os
from pathlib import Path
import signal
import time

import pytest
from support.controllers import emulated
from support.driver_process import driving

from ivfmc_ros.devices.controller import OffLine
from ivfmc_ros.devices.guard.beam_guard import BeamGuard


def shining(emulator):
    outputs = emulator.machine.present_outputs()
    return outputs.spindle > 0.0 or outputs.coolant > 0.0


def seconds_until(condition, limit=3.0):
    start = time.monotonic()
    while not condition():
        assert time.monotonic() - start < limit
        time.sleep(0.005)
    return time.monotonic() - start


def exists(pid):
    try:
        return Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0] != 'Z'
    except OSError:
        return False


@pytest.mark.parametrize(
    ('firmware', 'state', 'number'),
    [
        ('grblhal', 'moving', signal.SIGKILL),
        ('grbl', 'lit', signal.SIGSTOP),
        ('horus', 'lit', signal.SIGKILL),
        ('marlin', 'moving', signal.SIGKILL),
        ('fabscan', 'lit', signal.SIGSTOP),
    ],
)
def test_beam_is_off_within_a_second_of_a_driver_that_dies_or_hangs(
    tmp_path, firmware, state, number
):
    with emulated(firmware, tmp_path) as emulator:
        with driving(tmp_path / 'controller', firmware, state) as (process, guard):
            assert shining(emulator)
            process.send_signal(number)
            assert seconds_until(lambda: not shining(emulator)) < 1.0
        # neither the driver nor its guard is left
        assert seconds_until(lambda: not exists(guard)) < 2.0


@pytest.fixture
def pipe():
    reading, writing = os.pipe()
    yield reading, writing
    for handle in (reading, writing):
        os.close(handle)


@pytest.fixture
def guard():
    guard = BeamGuard()
    yield guard
    guard.end()


STEPS = ((b'off', 0.0),)


def received(reading, seconds=0.6):
    os.set_blocking(reading, False)
    time.sleep(seconds)
    try:
        return os.read(reading, 100)
    except BlockingIOError:
        return b''


def test_guard_sends_nothing_while_beats_come_and_when_it_is_ended(pipe, guard):
    reading, writing = pipe
    guard.start(OffLine(handle=writing, steps=STEPS), lambda: True, lambda: True)
    assert received(reading) == b''
    guard.end()
    assert received(reading, 0.1) == b''
    assert not guard.running


@pytest.mark.parametrize(('lit', 'sent'), [(False, b''), (True, b'off')])
def test_guard_acts_when_the_watchdog_hangs_only_where_a_laser_may_be_on(pipe, guard, lit, sent):
    reading, writing = pipe
    alive = [True]
    guard.start(OffLine(handle=writing, steps=STEPS), lambda: alive[0], lambda: lit)
    time.sleep(0.2)
    alive[0] = False
    assert received(reading)[:3] == sent


def test_driver_that_goes_on_knows_that_its_guard_has_acted(pipe, guard):
    reading, writing = pipe
    alive = [True]
    guard.start(OffLine(handle=writing, steps=STEPS), lambda: alive[0], lambda: True)
    time.sleep(0.2)
    assert guard.action == ''
    alive[0] = False
    assert received(reading)[:3] == b'off'
    alive[0] = True
    seconds_until(lambda: 'did not run for 0.35 s' in guard.action)
    guard.forgive()
    time.sleep(0.2)
    assert guard.action == ''


def test_guard_that_dies_is_a_fault(pipe, guard):
    guard.start(OffLine(handle=pipe[1], steps=STEPS), lambda: True, lambda: True)
    os.kill(guard.pid, signal.SIGKILL)
    seconds_until(lambda: 'has ended' in guard.fault)


def test_port_without_a_descriptor_is_a_fault(guard):
    guard.start(None, lambda: True, lambda: True)
    assert 'no file descriptor' in guard.fault


def hang_of_a_dark_cell(pipe, guard):
    """Start a guard whose driver says dark, and return the reading end and its hang."""
    reading, writing = pipe
    alive = [True]
    guard.start(OffLine(handle=writing, steps=STEPS), lambda: bool(alive), lambda: False)
    assert received(reading, 0.3) == b''
    return reading, alive.clear


def test_guard_of_a_dark_cell_acts_when_a_motion_or_laser_was_announced(pipe, guard):
    # the driver hangs at once after it
    reading, hang = hang_of_a_dark_cell(pipe, guard)
    hang()
    guard.announce()
    assert received(reading, 0.9).startswith(b'off')


def test_guard_of_a_dark_cell_sends_nothing_when_its_driver_hangs(pipe, guard):
    reading, hang = hang_of_a_dark_cell(pipe, guard)
    hang()
    assert received(reading, 0.9) == b''


def test_beats_of_a_cell_that_is_still_dark_do_not_take_an_announcement_back(pipe, guard):
    reading, hang = hang_of_a_dark_cell(pipe, guard)
    guard.announce()
    # beats go on until the laser is on; the driver hangs in that moment
    assert received(reading, 0.25) == b''
    hang()
    assert received(reading, 0.9).startswith(b'off')
