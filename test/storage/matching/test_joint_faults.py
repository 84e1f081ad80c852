# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reported positions that no table can have are left out or refused by name."""

import numpy as np
import pytest

from ivfmc_ros.errors import BagError
from ivfmc_ros.storage.matching.frame_matching import FrameMatcher
from ivfmc_ros.storage.matching.frame_matching import MatchSettings
from ivfmc_ros.storage.matching.joint_history import CONTRADICTORY
from ivfmc_ros.storage.matching.joint_history import GAP
from ivfmc_ros.storage.matching.joint_history import JointHistory
from ivfmc_ros.storage.matching.joint_history import TOO_FAST
from ivfmc_ros.storage.messages import sensor_messages

SECOND = 1_000_000_000
# 50 messages a second of a table that turns at 24 degrees a second, over one turn
STEP = SECOND // 50
SPEED = np.radians(24.0)
COUNT = 750
JOINT = 'turntable_joint'


def true_angle(stamp_ns):
    return SPEED * stamp_ns / SECOND


def turning(count=COUNT, velocity=SPEED, positions=None):
    """Return joint states of a turning table; ``positions`` replaces some by index."""
    positions = positions or {}
    return [
        sensor_messages.joint_state(
            index * STEP, {JOINT: positions.get(index, true_angle(index * STEP))}, velocity
        )
        for index in range(count)
    ]


def greatest_error(history):
    stamps = np.arange(STEP // 2, (COUNT - 1) * STEP, STEP // 3)
    found = np.array([history.position_at(int(stamp)) for stamp in stamps])
    error = found - true_angle(stamps)
    return np.abs((error + np.pi) % (2 * np.pi) - np.pi).max()


def test_stray_zeros_are_left_out_and_counted():
    zeros = dict.fromkeys(range(20, COUNT - 1, 37), 0.0)
    history = JointHistory.from_messages(turning(positions=zeros), JOINT, 'b')
    # only a zero that is nearer than the table moves in one message cannot be seen
    assert greatest_error(history) < SPEED * 0.04
    assert history.strays >= len(zeros) - 2
    assert f'{history.strays} positions of joint' in history.remarks(JOINT)[0]


def test_second_publisher_of_the_joint_is_refused_by_name():
    other = [
        sensor_messages.joint_state(index * STEP + STEP // 2, {JOINT: 0.0, 'gripper': 1.0}, 0.0)
        for index in range(COUNT)
    ]
    with pytest.raises(BagError, match=r'contradict each other.*two publishers.*gripper, turnt'):
        JointHistory.from_messages(turning() + other, JOINT, 'bag: joint_states')


def test_second_publisher_with_the_same_stamps_is_refused():
    other = [sensor_messages.joint_state(index * STEP, {JOINT: 0.0}) for index in range(COUNT)]
    with pytest.raises(BagError, match='two publishers'):
        JointHistory.from_messages(turning() + other, JOINT, 'bag: joint_states')


def test_images_while_positions_contradict_are_left_out():
    extra = [
        sensor_messages.joint_state(index * STEP + STEP // 2, {JOINT: 0.0})
        for index in range(300, 320)
    ]
    history = JointHistory.from_messages(turning() + extra, JOINT, 'b')
    assert history.fault_at(310 * STEP) == CONTRADICTORY
    assert history.fault_at(100 * STEP) == history.fault_at(600 * STEP) == ''
    matcher = FrameMatcher(('l',), MatchSettings(always_on=True), joint_history=history)
    for index in (100, 310, 600):
        matcher.add_image(index * STEP, index)
    assert [match.reason for match in matcher.pop_matches()] == ['', CONTRADICTORY, '']


@pytest.mark.parametrize('velocity', [0.0, -SPEED, 24.0])
def test_velocity_that_contradicts_the_positions_is_not_used(velocity):
    history = JointHistory.from_messages(turning(velocity=velocity), JOINT, 'b')
    found = [history.velocity_at(index * STEP + 7) for index in range(50, 700, 50)]
    np.testing.assert_allclose(found, SPEED, rtol=1e-3)
    assert 'the velocity of joint' in history.remarks(JOINT)[0]


def test_velocity_that_agrees_is_used():
    history = JointHistory.from_messages(turning(velocity=1.02 * SPEED), JOINT, 'b')
    assert history.velocity_at(300 * STEP) == pytest.approx(1.02 * SPEED)
    assert history.remarks(JOINT) == ()


def test_table_that_is_faster_than_any_is_left_out():
    # degrees instead of radians
    positions = {index: np.degrees(true_angle(index * STEP)) for index in range(COUNT)}
    history = JointHistory.from_messages(turning(velocity=None, positions=positions), JOINT, 'b')
    assert history.fault_at(300 * STEP) == TOO_FAST


def test_image_waits_until_the_newest_position_is_confirmed():
    matcher = FrameMatcher(('l',), MatchSettings(always_on=True))
    for index in range(100):
        matcher.add_table_position(index * STEP, true_angle(index * STEP), SPEED, 0.0)
    matcher.add_image(100 * STEP - 1, 'image', 0.0)
    matcher.add_table_position(100 * STEP, 0.0, SPEED, 0.0)
    assert list(matcher.pop_matches(0.0, 0.5)) == []
    matcher.add_table_position(101 * STEP, true_angle(101 * STEP), SPEED, 0.0)
    [match] = matcher.pop_matches(0.0, 0.5)
    assert match.angle == pytest.approx(true_angle(100 * STEP), abs=1e-5)


def test_step_motion_without_velocity_is_no_fault():
    """Positions of import-images: a step within 50 ms, then standstill."""
    history = JointHistory()
    for number in range(50):
        angle = np.radians(7.2) * number
        history.add(number * 5 * STEP, angle)
        history.add(number * 5 * STEP + 2 * STEP, angle)
    assert history.strays == 0
    assert history.remarks(JOINT) == ()
    assert not any(history.fault_at(number * 5 * STEP) for number in range(50))


def test_homing_that_sets_the_position_anew_is_no_stray():
    history = JointHistory()
    for index in range(50):
        history.add(index * STEP, 2.0 if index < 25 else 0.0, 0.0)
    assert history.strays == 0
    assert history.position_at(40 * STEP) == 0.0


def with_pause(seconds, velocity, after=0.0):
    """Return joint states with a pause from second 4; the table has moved on by ``after`` rad."""
    kept = [index for index in range(COUNT) if not 200 <= index < 200 + int(50 * seconds)]
    return [
        sensor_messages.joint_state(
            index * STEP,
            {JOINT: true_angle(index * STEP) + (after if index > 200 else 0.0)},
            velocity,
        )
        for index in kept
    ]


@pytest.mark.parametrize(
    ('seconds', 'velocity', 'after', 'reason'),
    [
        # the velocity at both ends is that of the motion between them
        (3.0, SPEED, 0.0, ''),
        # not reported: the table may have stood still meanwhile
        (3.0, None, 0.0, GAP),
        (3.0, SPEED, 0.2, GAP),
        (0.8, None, 0.0, ''),
    ],
)
def test_position_in_a_pause_is_used_only_where_the_motion_is_known(
    seconds, velocity, after, reason
):
    history = JointHistory.from_messages(with_pause(seconds, velocity, after), JOINT, 'x')
    middle = int((4.0 + seconds / 2) * SECOND)
    assert history.fault_at(middle) == reason
    assert history.fault_at(3 * SECOND) == history.fault_at(9 * SECOND) == ''
    # near a message the position follows from it
    assert history.fault_at(4 * SECOND + SECOND // 10) == ''


def test_table_at_rest_is_known_through_a_pause():
    states = [
        sensor_messages.joint_state(second * SECOND, {JOINT: 0.5}, None)
        for second in (0, 1, 9, 10)
    ]
    history = JointHistory.from_messages(states, JOINT, 'x')
    assert history.fault_at(5 * SECOND) == ''
