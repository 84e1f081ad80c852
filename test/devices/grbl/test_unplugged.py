# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A controller whose USB cable is pulled in a move, and put back."""

import time

import pytest

from ivfmc_ros.errors import ControllerLostError


def until(condition, seconds=10.0):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_unplugged_controller_is_dark_and_stands_until_it_is_plugged_in(controller, emulator):
    controller.set_laser('left')
    controller.move_to(3.0, 0.5, 3.0)
    until(lambda: abs(controller.poll().velocity) > 0.1)
    emulator.fault('unplug')
    until(lambda: controller.poll().alarm == 'CONTROLLER_LOST')
    outputs = emulator.machine.present_outputs()
    assert (outputs.spindle, outputs.coolant) == (0.0, 0.0)
    position = emulator.machine.axis.state_at(time.monotonic())
    time.sleep(0.1)
    assert emulator.machine.axis.state_at(time.monotonic()) == position
    with pytest.raises(ControllerLostError):
        controller.clear_alarm()

    emulator.fault('plug')
    controller.clear_alarm()
    assert controller.poll().alarm is None
    controller.set_laser('right')
    assert emulator.machine.present_outputs().coolant == 1.0
