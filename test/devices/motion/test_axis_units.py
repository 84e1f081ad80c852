# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import math

import pytest

from ivfmc_ros.devices.motion.axis_units import AxisUnits


def test_turns_are_radians():
    units = AxisUnits('X', 360.0)
    assert units.to_radians(90.0) == pytest.approx(math.pi / 2)
    assert units.from_radians(math.pi / 2) == pytest.approx(90.0)


def test_negative_units_turn_the_other_way():
    units = AxisUnits('A', -64.0)
    assert units.to_radians(16.0) == pytest.approx(-math.pi / 2)
    assert units.length(math.pi / 2) == pytest.approx(16.0)
    assert units.index == 3


def test_controller_that_starts_each_turn_at_zero_is_unwrapped():
    units = AxisUnits('X', 360.0)
    position = 0.0
    for true in range(0, 2000, 50):
        position = units.unwrap(true % 360, position)
        units.set_turns(true % 360, position)
        assert position == true
    assert units.to_controller(position) == 1950 % 360


def test_controller_that_restarts_at_zero_keeps_the_turns():
    units = AxisUnits('X', 360.0)
    assert units.unwrap(0.0, 725.0) == 720.0
    # a position that no second report confirmed does not count
    assert units.to_controller(730.0) == 730.0
    units.set_turns(0.0, 720.0)
    assert units.to_controller(730.0) == 10.0
