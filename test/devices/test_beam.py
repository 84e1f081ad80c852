# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import pytest

from ivfmc_ros.devices.beam import BeamKeeper
from ivfmc_ros.devices.beam import BeamRules
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


def keeper(clock, **rules):
    return BeamKeeper(['left', 'right'], BeamRules(**rules), clock)


def test_nothing_shines_at_first(clock):
    beam = keeper(clock).decide()
    assert beam.laser is None
    assert beam.urgent


def test_laser_shines_while_it_is_held(clock):
    keep = keeper(clock)
    for _ in range(20):
        keep.hold('left')
        clock.now += 0.2
        assert keep.decide().laser == 'left'


def test_half_a_second_of_silence_ends_the_beam(clock):
    keep = keeper(clock)
    keep.hold('left')
    clock.now += 0.49
    assert keep.decide().laser == 'left'
    clock.now += 0.02
    assert keep.decide().laser is None
    assert keep.decide().urgent


def test_hold_of_none_is_dark_but_in_order(clock):
    keep = keeper(clock)
    keep.hold('left')
    keep.hold('')
    assert keep.decide().laser is None
    assert not keep.decide().urgent


def test_unknown_laser_is_refused_and_nothing_shines(clock):
    keep = keeper(clock)
    keep.hold('left')
    with pytest.raises(ParameterError, match='there are left, right'):
        keep.hold('middle')
    assert keep.decide().laser is None


def test_permit_that_is_required_and_not_given_keeps_dark(clock):
    keep = keeper(clock, permit_required=True)
    keep.hold('left')
    assert keep.decide().laser is None
    keep.permit(True)
    assert keep.decide().laser == 'left'
    keep.permit(False)
    assert keep.decide().laser is None
    assert keep.decide().urgent


def test_permit_ends_after_its_time(clock):
    keep = keeper(clock, permit_required=True, permit_timeout=1.0)
    keep.permit(True)
    clock.now += 0.9
    keep.hold('left')
    assert keep.decide().laser == 'left'
    clock.now += 0.2
    assert keep.decide().laser is None


def test_by_hand_for_a_limited_time(clock):
    keep = keeper(clock, limit=3.0)
    keep.enable('right', True, moving=False)
    clock.now += 2.9
    assert keep.decide().laser == 'right'
    clock.now += 0.2
    assert keep.decide().laser is None


def test_by_hand_off_again(clock):
    keep = keeper(clock)
    keep.enable('right', True, moving=False)
    keep.enable('left', False, moving=False)
    assert keep.decide().laser == 'right'
    keep.enable('right', False, moving=False)
    assert keep.decide().laser is None


def test_by_hand_is_refused_in_a_scan(clock):
    keep = keeper(clock)
    keep.hold('')
    with pytest.raises(BusyError, match='idle'):
        keep.enable('left', True, moving=False)


def test_by_hand_is_refused_while_the_table_moves(clock):
    with pytest.raises(BusyError, match='idle'):
        keeper(clock).enable('left', True, moving=True)


def test_by_hand_is_refused_without_permit(clock):
    with pytest.raises(BusyError, match='permit'):
        keeper(clock, permit_required=True).enable('left', True, moving=False)


def test_by_hand_is_refused_for_a_laser_that_is_not_there(clock):
    with pytest.raises(ParameterError):
        keeper(clock).enable('middle', True, moving=False)


def test_scan_takes_over_from_the_hand(clock):
    keep = keeper(clock)
    keep.enable('right', True, moving=False)
    keep.hold('left')
    clock.now += 1.0
    assert keep.decide().laser is None


def test_what_was_stopped_stays_dark_until_it_is_let_go(clock):
    keep = keeper(clock)
    keep.hold('left')
    keep.stopped()
    keep.hold('left')
    assert keep.decide().laser is None
    keep.hold('')
    keep.hold('left')
    assert keep.decide().laser == 'left'


@pytest.mark.parametrize(
    'wrong', [{'hold_timeout': 0.0}, {'hold_timeout': float('nan')}, {'limit': -1.0}]
)
def test_rules_out_of_range_are_refused(wrong):
    with pytest.raises(ParameterError):
        BeamRules(**wrong)
