# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import math

import pytest

from ivfmc_ros.devices.motion import trajectory


@pytest.mark.parametrize(('start', 'target'), [(0.0, 10.0), (10.0, -3.0), (0.0, 0.1)])
def test_trapezoid_is_the_integral_of_its_velocity_and_ends_at_the_target(start, target):
    motion = trajectory.trapezoid(start, target, 2.0, 4.0, time=5.0)
    steps = 20000
    dt = (trajectory.end_time(motion) - 5.0) / steps
    way = sum(trajectory.state_at(motion, 5.0 + (i + 0.5) * dt)[1] * dt for i in range(steps))
    assert start + way == pytest.approx(target, abs=1e-6)
    assert trajectory.state_at(motion, trajectory.end_time(motion)) == (target, 0.0)
    assert (
        max(abs(trajectory.state_at(motion, 5.0 + i * dt)[1]) for i in range(steps)) <= 2.0 + 1e-9
    )


def test_axis_stands_before_the_begin():
    motion = trajectory.trapezoid(1.0, 2.0, 1.0, 1.0, time=5.0)
    assert trajectory.state_at(motion, 4.0) == (1.0, 0.0)


def test_trapezoid_without_distance_is_standstill():
    assert trajectory.trapezoid(1.0, 1.0, 1.0, 1.0, time=5.0) == trajectory.standstill(1.0, 5.0)


def test_brake_continues_from_the_present_state():
    motion = trajectory.trapezoid(0.0, 100.0, 2.0, 4.0, time=0.0)
    held = trajectory.brake(motion, 4.0, 3.0)
    assert trajectory.state_at(held, 3.0) == pytest.approx(trajectory.state_at(motion, 3.0))
    assert trajectory.end_time(held) == pytest.approx(3.5)
    assert held[-1].position == pytest.approx(trajectory.state_at(motion, 3.0)[0] + 0.5)


@pytest.mark.parametrize('target', [10.0, -10.0, 0.3])
def test_time_at_position_is_the_inverse(target):
    motion = trajectory.trapezoid(0.0, target, 2.0, 4.0, time=5.0)
    for part in (0.01, 0.2, 0.5, 0.8, 0.99):
        time = 5.0 + part * (trajectory.end_time(motion) - 5.0)
        found = trajectory.time_at_position(motion, trajectory.state_at(motion, time)[0])
        assert found == pytest.approx(time, abs=1e-6)


def test_position_off_the_trajectory_has_no_time():
    motion = trajectory.trapezoid(0.0, 10.0, 2.0, 4.0, time=0.0)
    assert trajectory.time_at_position(motion, 10.1) is None
    assert trajectory.time_at_position(motion, -0.1) is None
    assert math.isfinite(trajectory.time_at_position(motion, 10.0) or math.nan)
