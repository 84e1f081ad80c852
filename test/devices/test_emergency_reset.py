# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A driver that was killed with a laser on and the table turning, and the reset after it."""

import signal
import subprocess
import sys
import time

import pytest
from support.controllers import emulated
from support.controllers import settings_for

from ivfmc_ros.devices.any_controller import AnyController
from ivfmc_ros.devices.guard.emergency_reset import reset_controller
from ivfmc_ros.errors import ControllerLostError

DRIVER = (
    'import sys, time\n'
    'from ivfmc_ros.devices.grbl.controller import GrblController\n'
    'from ivfmc_ros.devices.settings import ControllerSettings\n'
    'controller = GrblController(\n'
    '    ControllerSettings(port=sys.argv[1], lasers={"left": "spindle", "right": "coolant"})\n'
    ')\n'
    'controller.open()\n'
    'controller.set_laser("left")\n'
    'controller.move_to(60.0, 1.0, 6.0)\n'
    'print("up", flush=True)\n'
    'time.sleep(60)\n'
)


def test_beam_and_table_stop_when_the_driver_is_killed(emulator, tmp_path):
    port = str(tmp_path / 'controller')
    driver = subprocess.Popen(
        [sys.executable, '-c', DRIVER, port], stdout=subprocess.PIPE, text=True
    )
    try:
        assert driver.stdout.readline() == 'up\n'
        driver.send_signal(signal.SIGSTOP)
    finally:
        driver.kill()
        driver.communicate()
    machine = emulator.machine
    assert machine._outputs.spindle
    begin = time.monotonic()
    assert machine.axis.state_at(begin)[1] != 0.0
    reset_controller(port, 115200)
    deadline = begin + 1.0
    while machine._outputs.spindle or machine.axis.state_at(time.monotonic())[1]:
        assert time.monotonic() < deadline
        time.sleep(0.01)


@pytest.mark.parametrize('firmware', ['horus', 'marlin', 'fabscan'])
def test_lasers_of_other_firmwares_go_off(firmware, tmp_path, monkeypatch):
    monkeypatch.setattr('ivfmc_ros.devices.detection._GREETING_S', 0.3)
    with emulated(firmware, tmp_path, auto_reset=False) as emulator:
        controller = AnyController(settings_for(firmware, tmp_path / 'controller'))
        controller.open()
        controller.set_laser('right')
        controller._driver._line.close()
        assert emulator.machine.present_outputs().coolant
        reset_controller(str(tmp_path / 'controller'), 115200)
        deadline = time.monotonic() + 1.0
        while emulator.machine.present_outputs().coolant:
            assert time.monotonic() < deadline
            time.sleep(0.01)


def test_port_that_is_gone_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr('ivfmc_ros.devices.guard.emergency_reset._OPEN_S', 0.1)
    with pytest.raises(ControllerLostError, match='cannot be opened'):
        reset_controller(str(tmp_path / 'none'), 115200)
