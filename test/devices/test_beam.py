# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import pytest

from ivfmc_ros.devices.beam import BeamInterlock
from ivfmc_ros.devices.beam import BeamSettings
from ivfmc_ros.errors import BusyError
from ivfmc_ros.errors import ParameterError


class FakeClock:
    def __init__(self):
        self.now = 1000.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return FakeClock()


def interlock(clock, **settings):
    return BeamInterlock(['left', 'right'], BeamSettings(**settings), clock)


def test_all_lasers_are_off_at_first(clock):
    beam = interlock(clock).decide()
    assert beam.laser is None
    assert beam.urgent


def test_laser_is_on_while_it_is_held(clock):
    lock = interlock(clock)
    for _ in range(20):
        lock.hold('left')
        clock.now += 0.2
        assert lock.decide().laser == 'left'


def test_laser_goes_off_half_a_second_after_the_last_hold(clock):
    lock = interlock(clock)
    lock.hold('left')
    clock.now += 0.49
    assert lock.decide().laser == 'left'
    clock.now += 0.02
    assert lock.decide().laser is None
    assert lock.decide().urgent


def test_hold_of_no_laser_is_not_urgent(clock):
    lock = interlock(clock)
    lock.hold('left')
    lock.hold('')
    assert lock.decide().laser is None
    assert not lock.decide().urgent


def test_unknown_laser_is_refused_and_all_go_off(clock):
    lock = interlock(clock)
    lock.hold('left')
    with pytest.raises(ParameterError, match='the lasers are: left, right'):
        lock.hold('middle')
    assert lock.decide().laser is None


def test_required_permit_that_is_missing_keeps_lasers_off(clock):
    lock = interlock(clock, permit_required=True)
    lock.hold('left')
    assert lock.decide().laser is None
    lock.permit(True)
    assert lock.decide().laser == 'left'
    lock.permit(False)
    assert lock.decide().laser is None
    assert lock.decide().urgent


def test_permit_ends_after_its_timeout(clock):
    lock = interlock(clock, permit_required=True, permit_timeout=1.0)
    lock.permit(True)
    clock.now += 0.9
    lock.hold('left')
    assert lock.decide().laser == 'left'
    clock.now += 0.2
    assert lock.decide().laser is None


def test_manual_request_ends_after_its_limit(clock):
    lock = interlock(clock, limit=3.0)
    lock.enable('right', True, moving=False)
    clock.now += 2.9
    assert lock.decide().laser == 'right'
    clock.now += 0.2
    assert lock.decide().laser is None


def test_manual_request_turns_a_laser_off(clock):
    lock = interlock(clock)
    lock.enable('right', True, moving=False)
    lock.enable('left', False, moving=False)
    assert lock.decide().laser == 'right'
    lock.enable('right', False, moving=False)
    assert lock.decide().laser is None


def test_manual_request_is_refused_in_a_scan(clock):
    lock = interlock(clock)
    lock.hold('')
    with pytest.raises(BusyError, match='idle'):
        lock.enable('left', True, moving=False)


def test_manual_request_is_refused_while_the_table_moves(clock):
    with pytest.raises(BusyError, match='idle'):
        interlock(clock).enable('left', True, moving=True)


def test_manual_request_is_refused_without_permit(clock):
    with pytest.raises(BusyError, match='permit'):
        interlock(clock, permit_required=True).enable('left', True, moving=False)


def test_manual_request_for_an_unknown_laser_is_refused(clock):
    with pytest.raises(ParameterError):
        interlock(clock).enable('middle', True, moving=False)


def test_hold_replaces_a_manual_request(clock):
    lock = interlock(clock)
    lock.enable('right', True, moving=False)
    lock.hold('left')
    clock.now += 1.0
    assert lock.decide().laser is None


def test_stopped_laser_stays_off_until_its_hold_ends(clock):
    lock = interlock(clock)
    lock.hold('left')
    lock.block()
    lock.hold('left')
    assert lock.decide().laser is None
    lock.hold('')
    lock.hold('left')
    assert lock.decide().laser == 'left'


def test_interrupted_laser_stays_off_when_its_hold_begins_again(clock):
    lock = interlock(clock)
    lock.hold('left')
    clock.now += 1.3
    lock.interrupt()
    for _ in range(50):
        lock.hold('left')
        assert lock.decide().laser is None
        clock.now += 0.1
    lock.hold('')
    lock.hold('left')
    assert lock.decide().laser == 'left'


def test_interrupted_laser_is_released_by_silence(clock):
    lock = interlock(clock)
    lock.hold('left')
    clock.now += 1.3
    lock.interrupt()
    clock.now += 2.6
    lock.hold('left')
    assert lock.decide().laser == 'left'


@pytest.mark.parametrize(
    'wrong', [{'hold_timeout': 0.0}, {'hold_timeout': float('nan')}, {'limit': -1.0}]
)
def test_settings_out_of_range_are_refused(wrong):
    with pytest.raises(ParameterError):
        BeamSettings(**wrong)
