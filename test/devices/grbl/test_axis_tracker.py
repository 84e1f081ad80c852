# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import pytest

from ivfmc_ros.devices.grbl import axis_tracker
from ivfmc_ros.devices.grbl.axis_tracker import AxisTracker
from ivfmc_ros.devices.grbl.protocol import StatusReport
from ivfmc_ros.devices.motion import trajectory
from ivfmc_ros.devices.motion.axis_units import AxisUnits

PLAN = trajectory.trapezoid(0.0, 360.0, 60.0, 400.0, 0.0)


BEGIN = 1000.0


class Clock:
    now = BEGIN

    def monotonic(self):
        return self.now

    def time_ns(self):
        return int(1e9 * self.now)


@pytest.fixture
def tracker(monkeypatch):
    monkeypatch.setattr(axis_tracker, 'time', Clock())
    tracker = AxisTracker(AxisUnits('X', 360.0))
    tracker.announce(PLAN)
    tracker.begin(BEGIN)
    return tracker


def report(tracker, seconds, position_at):
    """Report ten times a second for some seconds; returns whether the axis is lost."""
    for number in range(1, round(10 * seconds)):
        now = axis_tracker.time.now = BEGIN + 0.1 * number
        tracker.update(
            StatusReport(state='Run', machine=(position_at(now),), decimals=(3,)),
            (now - 0.004, now + 0.004),
            waiting=False,
            in_inches=False,
            max_rate=100.0,
        )
    return tracker.lost


def planned(late=0.0, speed=1.0):
    return lambda now: trajectory.state_at(PLAN, max(0.0, speed * (now - BEGIN - late)))[0]


@pytest.mark.parametrize('late', [-1.5, -0.8, -0.4, 0.0, 0.4])
def test_motion_whose_begin_was_noticed_late_or_early_is_no_lost_position(tracker, late):
    position_at = planned(late)
    assert not report(tracker, 4.0, position_at)
    # the plan was shifted: the position between reports is right
    assert tracker.state_at(BEGIN + 3.9)[0] == pytest.approx(position_at(BEGIN + 3.9), abs=1.5)


@pytest.mark.parametrize('speed', [0.5, 1.5])
def test_motion_at_another_speed_is_a_lost_position(tracker, speed):
    assert report(tracker, 4.0, planned(speed=speed))


def test_axis_that_is_held_up_in_the_middle_is_a_lost_position(tracker):
    def position_at(now):
        return planned()(now if now < BEGIN + 2.5 else now - 0.6)

    assert report(tracker, 4.0, position_at)


def test_axis_that_stands_is_a_lost_position(tracker):
    assert report(tracker, 2.0, lambda now: 0.0)


def test_axis_that_goes_the_other_way_is_a_lost_position(tracker):
    assert report(tracker, 2.0, lambda now: -planned()(now))


@pytest.mark.parametrize('slip', [0.0, 5.0])
def test_index_mark_that_is_late_is_a_lost_position(monkeypatch, slip):
    monkeypatch.setattr(axis_tracker, 'time', Clock())
    tracker = AxisTracker(AxisUnits('X', 360.0), 'X')
    plan = trajectory.trapezoid(0.0, 1080.0, 30.0, 400.0, 0.0)
    tracker.announce(plan)
    tracker.begin(BEGIN)
    for number in range(1, 350):
        now = axis_tracker.time.now = BEGIN + 0.1 * number
        position = trajectory.state_at(plan, 0.1 * number)[0]
        mark = (position - slip * (position > 500.0)) % 360.0
        tracker.update(
            StatusReport(
                state='Run',
                machine=(round(position, 3),),
                decimals=(3,),
                pins='X' if 100.0 <= mark < 130.0 else '',
            ),
            (now, now + 0.01),
            waiting=False,
            in_inches=False,
            max_rate=120.0,
        )
    assert tracker.lost == bool(slip)
    assert ('the table slipped' in tracker.index_text) == bool(slip)
    # the operator accepts the position
    tracker.forget_standstill()
    assert not tracker.lost
    assert tracker.index_text == 'not passed yet'
