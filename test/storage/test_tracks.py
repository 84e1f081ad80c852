# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.errors import BagError
from ivfmc_ros.storage.messages import build
from ivfmc_ros.storage.tracks import JointTrack
from ivfmc_ros.storage.tracks import LaserTrack

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND


def _stamps(*seconds):
    return np.array([START + round(second * SECOND) for second in seconds], dtype=np.int64)


def _joints(*states):
    return [build.joint_state(int(_stamps(second)[0]), positions) for second, positions in states]


def test_angle_is_interpolated_at_the_stamp():
    track = JointTrack(_stamps(0, 1, 2), [0.0, 0.1, 0.3])
    np.testing.assert_allclose(track.at(_stamps(0, 0.5, 1.25, 2)), [0, 0.05, 0.15, 0.3])


def test_nanoseconds_of_today_are_not_rounded_away():
    track = JointTrack([START + 7, START + 1007], [0.0, 1.0])
    np.testing.assert_allclose(track.at(np.array([START + 107])), [0.1])


def test_reports_may_come_out_of_order():
    track = JointTrack(_stamps(2, 0, 1), [0.2, 0.0, 0.1])
    np.testing.assert_allclose(track.at(_stamps(1.5)), [0.15])


def test_position_modulo_a_turn_is_unwrapped():
    angles = np.linspace(0, 14, 200)
    track = JointTrack(_stamps(*np.arange(200) / 50), np.angle(np.exp(1j * angles)))
    np.testing.assert_allclose(track.positions, angles)


def test_motion_goes_on_for_a_moment_at_the_ends():
    track = JointTrack(_stamps(*np.arange(11) / 10), np.arange(11) / 10)
    wanted = _stamps(-0.2, 1.2)
    assert track.covers(wanted).all()
    np.testing.assert_allclose(track.at(wanted), [-0.2, 1.2])


def test_standstill_stays_still_at_the_ends():
    track = JointTrack(_stamps(0, 0.5, 1, 1.5), [0.3, 0.3, 0.7, 0.7])
    np.testing.assert_allclose(track.at(_stamps(-0.2, 1.7)), [0.3, 0.7])


def test_single_report_is_where_the_table_is():
    np.testing.assert_allclose(JointTrack(_stamps(0), [0.3]).at(_stamps(-0.1, 0.1)), 0.3)


def test_far_from_the_reports_nothing_is_known():
    track = JointTrack(_stamps(0, 1), [0.0, 0.1])
    assert track.covers(_stamps(-0.26, -0.24, 0.5, 1.24, 1.26)).tolist() == [
        False, True, True, True, False,
    ]  # fmt: skip


def test_other_joints_on_the_topic_are_left_alone():
    states = [(0, {'lift': 9.0, 'turntable_joint': 0.1}), (1, {'lift': 9.0})]
    track = JointTrack.of(_joints(*states), 'turntable_joint', 'x')
    assert track.positions.tolist() == [0.1]


def test_missing_joint_is_named_with_those_there_are():
    with pytest.raises(BagError, match=r"^/j: has no position of joint 'table'; .*: arm, lift"):
        JointTrack.of(_joints((0, {'lift': 9.0, 'arm': 1.0})), 'table', '/j')


def test_joint_without_position_is_missing():
    states = _joints((0, {'table': 1.0}))
    states[0].position = np.empty(0)
    with pytest.raises(BagError, match="has no position of joint 'table'"):
        JointTrack.of(states, 'table', '/j')


def test_positions_that_are_no_numbers_are_none():
    nowhere = (0, {'table': np.nan})
    with pytest.raises(BagError, match="no position of joint 'table' is a finite number"):
        JointTrack.of(_joints(nowhere), 'table', '/j')
    track = JointTrack.of(_joints(nowhere, (1, {'table': 0.5}), (2, {'table': 1.5})), 'table', '')
    np.testing.assert_allclose(track.at(_stamps(1.5)), [1.0])
    assert list(track.covers(_stamps(0, 1, 2))) == [False, True, True]


LEFT = {'left': 1.0, 'right': 0.0}
RIGHT = {'left': 0.0, 'right': 1.0}


def _lasers(*states):
    return LaserTrack.of(_joints(*states), ('left', 'right'), '/l')


def _during(track, second, exposure=0.02):
    return track.during(int(_stamps(second)[0]), round(exposure * SECOND))


def test_laser_is_the_latest_reported():
    track = _lasers((0, LEFT), (1, LEFT), (2, RIGHT))
    assert _during(track, 0) == (0, '')
    assert _during(track, 1.9) == (0, '')
    assert _during(track, 2) == (1, '')


def test_exposure_that_overlaps_a_change_is_not_used():
    track = _lasers((0, LEFT), (1, RIGHT))
    assert _during(track, 0.99) == (None, 'laser changed')
    assert _during(track, 0.97) == (0, '')


def test_repeated_report_is_no_change():
    assert _during(_lasers((0, LEFT), (1, LEFT)), 0.99) == (0, '')


def test_dark_and_unknown_are_off():
    track = _lasers((0, {'left': 0.0, 'right': 0.0}))
    assert _during(track, -1) == (None, 'laser off')
    assert _during(track, 1) == (None, 'laser off')


def test_two_lasers_at_once_are_none():
    assert _during(_lasers((0, {'left': 1.0, 'right': 1.0})), 1) == (None, 'two lasers on')


def test_laser_that_is_not_named_is_as_it_was():
    track = _lasers((0, LEFT), (1, {'right': 0.0}), (2, {'lamp': 1.0}))
    assert _during(track, 3) == (0, '')


def test_lasers_of_another_cell_are_named():
    with pytest.raises(BagError, match=r'/l: names none of the lasers left, right; .*: lamp'):
        _lasers((0, {'lamp': 1.0}))
