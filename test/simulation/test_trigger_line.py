# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.devices.motion import trajectory
from ivfmc_ros.simulation.trigger_line import TriggerLine

STEP = 0.8
MOVE = trajectory.trapezoid(0.3, 100.7, 24.0, 100.0, 1.0)


def line(**faults):
    made = TriggerLine(STEP, seed=3)
    for name, value in faults.items():
        setattr(made, name, value)
    made.move(0.0, MOVE)
    return made


def test_pulses_come_where_the_axis_passes_multiples_of_the_step():
    times = line().advance(10.0)
    positions = [trajectory.state_at(MOVE, time)[0] - 0.3 for time in times]
    np.testing.assert_allclose(positions, STEP * np.arange(1, 126), atol=1e-9)
    assert times == sorted(times)


def test_small_advances_give_the_same_pulses():
    one, many = line(), line()
    found = [time for until in np.arange(0.0, 10.0, 0.013) for time in many.advance(until)]
    np.testing.assert_allclose(found + many.advance(10.0), one.advance(10.0), atol=1e-9)


def test_the_way_back_has_the_same_grid():
    made = line()
    there = made.advance(10.0)
    back = trajectory.trapezoid(100.7, 0.6, 24.0, 100.0, 11.0)
    made.move(10.0, back)
    times = made.advance(20.0)
    positions = [trajectory.state_at(back, time)[0] - 0.3 for time in times]
    np.testing.assert_allclose(positions, STEP * np.arange(125, 0, -1), atol=1e-9)
    assert len(there) == len(times)


def test_table_that_slips_and_a_counter_that_is_reset_make_no_pulse():
    made = line()
    times = made.move(2.0, trajectory.shift(MOVE, 7.1)) + made.advance(10.0)
    np.testing.assert_allclose(times, line().advance(10.0), atol=1e-9)


def test_standing_axis_gives_none():
    made = line(noise=50.0)
    made.advance(10.0)
    assert made.advance(100.0) == []


def test_faults_are_seeded_and_have_their_probability():
    faulty = line(drop=0.2, double=0.1).advance(10.0)
    assert faulty == line(drop=0.2, double=0.1).advance(10.0)
    good = line().advance(10.0)
    lost = [time for time in good if min(abs(time - other) for other in faulty) > 1e-9]
    late = [time for time in faulty if min(abs(time - other) for other in good) > 1e-9]
    assert 12 <= len(lost) <= 38
    assert 3 <= len(late) <= 20
    for time in late:
        assert 0.006 <= min(time - other for other in good if other < time) <= 0.012


def test_false_pulses_come_while_the_axis_moves():
    good, noisy = line().advance(10.0), line(noise=10.0).advance(10.0)
    assert len(noisy) - len(good) == pytest.approx(10.0 * 4.4, abs=20)
