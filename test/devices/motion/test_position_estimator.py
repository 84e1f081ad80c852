# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.devices.motion import trajectory
from ivfmc_ros.devices.motion.position_estimator import PositionEstimator

TURN = trajectory.trapezoid(0.0, 360.0, 24.0, 360.0, time=0.0)


def follow(scale, delay, jitter, seed=0, estimator=None):
    """Estimate a turn of 15 s from 8 reports a second; return times, errors and the estimator."""
    rng = np.random.default_rng(seed)
    estimator = estimator or PositionEstimator()
    estimator.begin(TURN, 100.0)

    def truth(time):
        return trajectory.state_at(TURN, scale * (time - 100.0 - delay))[0]

    times, errors = [], []
    for time in np.arange(100.0, 114.5, 0.02):
        if round((time - 100.0) / 0.02) % 6 == 0:
            estimator.update(time + rng.normal(0, jitter), truth(time))
        times.append(time)
        errors.append(estimator.state_at(time)[0] - truth(time))
    return np.array(times), np.array(errors), estimator


def test_clock_scale_is_estimated():
    _, errors, estimator = follow(scale=1.004, delay=0.015, jitter=0.004)
    assert estimator.scale == pytest.approx(1.004, abs=3e-4)
    assert abs(errors[-200:]).max() < 24.0 * 0.003


def test_jitter_of_reports_is_smoothed():
    _, errors, _ = follow(scale=1.0, delay=0.01, jitter=0.005)
    # at face value 5 ms are 0.12 degrees from report to report
    steps = np.diff(errors[100:])
    assert abs(steps).max() < 0.02


def test_position_never_jumps_nor_turns_back():
    estimator = PositionEstimator()
    follow(scale=0.996, delay=0.02, jitter=0.005, estimator=estimator)
    positions = [estimator.state_at(time)[0] for time in np.arange(100.0, 114.0, 0.01)]
    assert (np.diff(positions) >= 0).all()


def test_estimated_scale_is_kept_for_the_next_move():
    _, first, estimator = follow(scale=1.004, delay=0.0, jitter=0.002)
    _, second, _ = follow(scale=1.004, delay=0.0, jitter=0.002, seed=1, estimator=estimator)
    assert abs(second[:200]).max() < 0.5 * abs(first[:200]).max()


def test_late_report_is_an_outlier():
    estimator = PositionEstimator()
    estimator.begin(TURN, 0.0)
    for time in np.arange(1.0, 5.0, 0.125):
        estimator.update(time, trajectory.state_at(TURN, time)[0])
    before = estimator.state_at(6.0)[0]
    estimator.update(5.5, trajectory.state_at(TURN, 5.0)[0])  # half a second late
    assert estimator.state_at(6.0)[0] == pytest.approx(before, abs=1e-6)


def test_report_off_the_trajectory_is_ignored():
    estimator = PositionEstimator()
    estimator.begin(TURN, 0.0)
    estimator.update(1.0, -50.0)
    assert estimator.state_at(2.0) == pytest.approx(trajectory.state_at(TURN, 2.0))


def test_brake_ends_in_standstill():
    estimator = PositionEstimator()
    estimator.begin(TURN, 0.0)
    position = estimator.state_at(3.0)[0]
    estimator.brake(360.0, 3.0)
    assert estimator.state_at(3.0)[0] == pytest.approx(position)
    assert estimator.state_at(4.0) == pytest.approx((position + 24.0**2 / 720, 0.0))
