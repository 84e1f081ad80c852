# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.devices.motion import ramp
from ivfmc_ros.devices.motion.position_estimator import Follower

TURN = ramp.ramp(0.0, 360.0, 24.0, 360.0, time=0.0)


def follow(scale, delay, jitter, seed=0, follower=None):
    """Follow a turn of 15 s that is reported 8 times a second; give times and errors in units."""
    rng = np.random.default_rng(seed)
    follower = follower or Follower()
    follower.begin(TURN, 100.0)

    def truth(time):
        return ramp.at(TURN, scale * (time - 100.0 - delay))[0]

    times, errors = [], []
    for time in np.arange(100.0, 114.5, 0.02):
        if round((time - 100.0) / 0.02) % 6 == 0:
            follower.report(time + rng.normal(0, jitter), truth(time))
        times.append(time)
        errors.append(follower.at(time)[0] - truth(time))
    return np.array(times), np.array(errors), follower


def test_clock_of_the_board_is_learnt():
    _, errors, follower = follow(scale=1.004, delay=0.015, jitter=0.004)
    assert follower.scale == pytest.approx(1.004, abs=3e-4)
    assert abs(errors[-200:]).max() < 24.0 * 0.003


def test_jitter_of_reports_does_not_reach_the_position():
    _, errors, _ = follow(scale=1.0, delay=0.01, jitter=0.005)
    # at face value 5 ms are 0.12 degrees from report to report
    steps = np.diff(errors[100:])
    assert abs(steps).max() < 0.02


def test_position_never_jumps_nor_turns_back():
    follower = Follower()
    follow(scale=0.996, delay=0.02, jitter=0.005, follower=follower)
    positions = [follower.at(time)[0] for time in np.arange(100.0, 114.0, 0.01)]
    assert (np.diff(positions) >= 0).all()


def test_what_was_learnt_helps_the_next_move():
    _, first, follower = follow(scale=1.004, delay=0.0, jitter=0.002)
    _, second, _ = follow(scale=1.004, delay=0.0, jitter=0.002, seed=1, follower=follower)
    assert abs(second[:200]).max() < 0.5 * abs(first[:200]).max()


def test_report_that_was_held_up_is_not_believed():
    follower = Follower()
    follower.begin(TURN, 0.0)
    for time in np.arange(1.0, 5.0, 0.125):
        follower.report(time, ramp.at(TURN, time)[0])
    before = follower.at(6.0)[0]
    follower.report(5.5, ramp.at(TURN, 5.0)[0])  # half a second late
    assert follower.at(6.0)[0] == pytest.approx(before, abs=1e-6)


def test_reports_off_the_way_change_nothing():
    follower = Follower()
    follower.begin(TURN, 0.0)
    follower.report(1.0, -50.0)
    assert follower.at(2.0) == pytest.approx(ramp.at(TURN, 2.0))


def test_brake_ends_in_rest():
    follower = Follower()
    follower.begin(TURN, 0.0)
    position = follower.at(3.0)[0]
    follower.brake(360.0, 3.0)
    assert follower.at(3.0)[0] == pytest.approx(position)
    assert follower.at(4.0) == pytest.approx((position + 24.0**2 / 720, 0.0))
