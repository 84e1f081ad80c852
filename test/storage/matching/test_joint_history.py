# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.errors import BagError
from ivfmc_ros.storage.matching.joint_history import JointHistory
from ivfmc_ros.storage.messages import sensor_messages

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND


def _stamps(*seconds):
    return [START + round(second * SECOND) for second in seconds]


def _message(second, positions):
    return sensor_messages.joint_state(_stamps(second)[0], positions)


def _history(stamps_ns, positions):
    states = zip(stamps_ns, positions, strict=True)
    messages = [sensor_messages.joint_state(stamp, {'table': angle}) for stamp, angle in states]
    return JointHistory.from_messages(messages, 'table', '/j')


def _positions(history, stamps_ns):
    return [history.position_at(stamp) for stamp in stamps_ns]


def test_angle_is_interpolated_at_the_stamp():
    history = _history(_stamps(0, 1, 2), [0.0, 0.1, 0.3])
    found = _positions(history, _stamps(0, 0.5, 1.25, 2))
    np.testing.assert_allclose(found, [0, 0.05, 0.15, 0.3])


def test_nanoseconds_of_present_stamps_are_not_rounded():
    history = _history([START + 7, START + 1007], [0.0, 1.0])
    assert history.position_at(START + 107) == pytest.approx(0.1)


def test_messages_may_be_out_of_order():
    history = _history(_stamps(2, 0, 1), [0.2, 0.0, 0.1])
    assert history.position_at(_stamps(1.5)[0]) == pytest.approx(0.15)


def test_position_modulo_a_turn_is_unwrapped():
    angles = np.linspace(0, 14, 200)
    stamps_ns = _stamps(*np.arange(200) / 50)
    history = _history(stamps_ns, np.angle(np.exp(1j * angles)))
    np.testing.assert_allclose(_positions(history, stamps_ns), angles)


def test_motion_is_extrapolated_at_the_ends():
    history = _history(_stamps(*np.arange(11) / 10), np.arange(11) / 10)
    stamps_ns = _stamps(-0.2, 1.2)
    assert all(history.covers(stamp) for stamp in stamps_ns)
    np.testing.assert_allclose(_positions(history, stamps_ns), [-0.2, 1.2])


def test_standstill_stays_one_at_the_ends():
    history = _history(_stamps(0, 0.5, 1, 1.5), [0.3, 0.3, 0.7, 0.7])
    np.testing.assert_allclose(_positions(history, _stamps(-0.2, 1.7)), [0.3, 0.7])


def test_single_message_holds_around_its_stamp():
    history = _history(_stamps(0), [0.3])
    np.testing.assert_allclose(_positions(history, _stamps(-0.1, 0.1)), 0.3)


def test_positions_far_from_the_messages_are_unknown():
    history = _history(_stamps(0, 1), [0.0, 0.1])
    assert [history.covers(stamp) for stamp in _stamps(-0.26, -0.24, 0.5, 1.24, 1.26)] == [
        False, True, True, True, False,
    ]  # fmt: skip


def test_other_joints_on_the_topic_are_ignored():
    messages = [
        _message(0, {'lift': 9.0, 'turntable_joint': 0.1}),
        _message(1, {'lift': 9.0}),
    ]
    history = JointHistory.from_messages(messages, 'turntable_joint', 'x')
    assert history.stamps_ns == _stamps(0)
    assert history.position_at(START) == 0.1


def test_missing_joint_is_named_with_the_existing_ones():
    messages = [_message(0, {'lift': 9.0, 'arm': 1.0})]
    with pytest.raises(BagError, match=r"^/j: has no position of joint 'table'; .*: arm, lift"):
        JointHistory.from_messages(messages, 'table', '/j')


def test_joint_without_position_is_missing():
    message = _message(0, {'table': 1.0})
    message.position = np.empty(0)
    with pytest.raises(BagError, match="has no position of joint 'table'"):
        JointHistory.from_messages([message], 'table', '/j')


def test_positions_that_are_not_finite_are_ignored():
    unknown = _message(0, {'table': np.nan})
    with pytest.raises(BagError, match="no position of joint 'table' is a finite number"):
        JointHistory.from_messages([unknown], 'table', '/j')
    messages = [unknown, _message(1, {'table': 0.5}), _message(2, {'table': 1.5})]
    history = JointHistory.from_messages(messages, 'table', '')
    assert history.position_at(_stamps(1.5)[0]) == pytest.approx(1.0)
    assert [history.covers(stamp) for stamp in _stamps(0, 1, 2)] == [False, True, True]
