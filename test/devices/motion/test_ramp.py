# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import math

import pytest

from ivfmc_ros.devices.motion import ramp


@pytest.mark.parametrize(('start', 'target'), [(0.0, 10.0), (10.0, -3.0), (0.0, 0.1)])
def test_ramp_is_the_integral_of_its_velocity_and_ends_at_the_target(start, target):
    motion = ramp.ramp(start, target, 2.0, 4.0, time=5.0)
    steps = 20000
    dt = (ramp.end(motion) - 5.0) / steps
    way = sum(ramp.at(motion, 5.0 + (i + 0.5) * dt)[1] * dt for i in range(steps))
    assert start + way == pytest.approx(target, abs=1e-6)
    assert ramp.at(motion, ramp.end(motion)) == (target, 0.0)
    assert max(abs(ramp.at(motion, 5.0 + i * dt)[1]) for i in range(steps)) <= 2.0 + 1e-9


def test_nothing_moves_before_the_ramp_begins():
    motion = ramp.ramp(1.0, 2.0, 1.0, 1.0, time=5.0)
    assert ramp.at(motion, 4.0) == (1.0, 0.0)


def test_ramp_to_where_it_is_is_rest():
    assert ramp.ramp(1.0, 1.0, 1.0, 1.0, time=5.0) == ramp.rest(1.0, 5.0)


def test_halt_brakes_from_where_it_is():
    motion = ramp.ramp(0.0, 100.0, 2.0, 4.0, time=0.0)
    held = ramp.halt(motion, 4.0, 3.0)
    assert ramp.at(held, 3.0) == pytest.approx(ramp.at(motion, 3.0))
    assert ramp.end(held) == pytest.approx(3.5)
    assert held[-1].position == pytest.approx(ramp.at(motion, 3.0)[0] + 0.5)


@pytest.mark.parametrize('target', [10.0, -10.0, 0.3])
def test_time_of_a_position_is_the_inverse(target):
    motion = ramp.ramp(0.0, target, 2.0, 4.0, time=5.0)
    for part in (0.01, 0.2, 0.5, 0.8, 0.99):
        time = 5.0 + part * (ramp.end(motion) - 5.0)
        found = ramp.time_of(motion, ramp.at(motion, time)[0])
        assert found == pytest.approx(time, abs=1e-6)


def test_positions_off_the_way_have_no_time():
    motion = ramp.ramp(0.0, 10.0, 2.0, 4.0, time=0.0)
    assert ramp.time_of(motion, 10.1) is None
    assert ramp.time_of(motion, -0.1) is None
    assert math.isfinite(ramp.time_of(motion, 10.0) or math.nan)
