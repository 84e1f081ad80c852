# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import pytest

from ivfmc_ros.errors import BagError
from ivfmc_ros.storage.matching.laser_history import LaserHistory
from ivfmc_ros.storage.messages import sensor_messages

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
LEFT = {'left': 1.0, 'right': 0.0}
RIGHT = {'left': 0.0, 'right': 1.0}


def _history(*states):
    messages = [
        sensor_messages.joint_state(START + second * SECOND, positions)
        for second, positions in states
    ]
    return LaserHistory.from_messages(messages, ('left', 'right'), '/l')


def _during(history, second, exposure=0.02):
    return history.laser_during(START + round(second * SECOND), round(exposure * SECOND))


def test_laser_is_that_of_the_latest_message():
    history = _history((0, LEFT), (1, LEFT), (2, RIGHT))
    assert _during(history, 0) == (0, '')
    assert _during(history, 1.9) == (0, '')
    assert _during(history, 2) == (1, '')


def test_exposure_that_overlaps_a_change_is_not_used():
    history = _history((0, LEFT), (1, RIGHT))
    assert _during(history, 0.99) == (None, 'laser changed')
    assert _during(history, 0.97) == (0, '')


def test_repeated_message_is_no_change():
    assert _during(_history((0, LEFT), (1, LEFT)), 0.99) == (0, '')


def test_lasers_off_and_unknown_lasers_are_none():
    history = _history((0, {'left': 0.0, 'right': 0.0}))
    assert _during(history, -1) == (None, 'lasers not known')
    assert _during(history, 1) == (None, 'laser off')


def test_two_lasers_at_once_are_none():
    assert _during(_history((0, {'left': 1.0, 'right': 1.0})), 1) == (None, 'two lasers on')


def test_laser_that_is_not_named_keeps_its_state():
    history = _history((0, LEFT), (1, {'right': 0.0}), (2, {'lamp': 1.0}))
    assert _during(history, 3) == (0, '')


def test_lasers_of_another_cell_are_named():
    with pytest.raises(BagError, match=r'/l: names none of the lasers left, right; .*: lamp'):
        _history((0, {'lamp': 1.0}))
