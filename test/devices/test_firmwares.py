# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Each firmware connects, moves, lights, stops and homes, against its emulator.

``make bench NAME=hardware`` lets each recover from a silence as well, which takes ten seconds.
"""

import pytest
from support import controller_features as features
from support.controllers import connected
from support.controllers import emulated
from support.controllers import FIRMWARES
from support.controllers import settings_for

from ivfmc_ros.devices.any_controller import AnyController
from ivfmc_ros.errors import ControllerLostError
from ivfmc_ros.errors import ControllerRefusedError


@pytest.fixture(params=FIRMWARES)
def rig(request, tmp_path):
    with connected(request.param, tmp_path) as rig:
        yield rig


def test_connects_moves_and_lights(rig):
    features.connects(rig)
    features.moves(rig)
    features.lights(rig)


def test_stops_in_a_move_and_goes_on_from_there(rig):
    features.stops(rig)


@pytest.mark.parametrize('firmware', FIRMWARES)
def test_homes_or_says_that_it_cannot(firmware, tmp_path):
    features.homes(firmware, tmp_path)


@pytest.mark.parametrize('firmware', ['grblhal', 'fluidnc'])
def test_rotary_axis_is_taken_where_there_is_one(firmware, tmp_path):
    with connected(firmware, tmp_path) as rig:
        assert rig.emulator.machine.firmware.axis == 'A'
        rig.go(0.1)
        rig.arrive()
        assert rig.true_position() == pytest.approx(0.1, abs=features.HALF_STEP)


def test_axis_that_the_controller_does_not_have_is_refused_with_those_it_has(tmp_path):
    with emulated('grblhal', tmp_path):
        controller = AnyController(settings_for('grblhal', tmp_path / 'controller', axis='B'))
        with pytest.raises(ControllerRefusedError, match='no axis B; it has X, Y, Z, A'):
            controller.open()


def test_output_of_another_firmware_is_refused_with_those_it_has(tmp_path):
    with emulated('horus', tmp_path):
        controller = AnyController(settings_for('grbl', tmp_path / 'controller'))
        with pytest.raises(ControllerRefusedError, match='Horus, which has laser1, laser2'):
            controller.open()


@pytest.mark.parametrize('firmware', ['grblhal', 'fluidnc', 'marlin', 'fabscan'])
def test_port_that_does_not_reset_the_controller(firmware, tmp_path, monkeypatch):
    monkeypatch.setattr('ivfmc_ros.devices.detection._GREETING_S', 0.3)
    with emulated(firmware, tmp_path, auto_reset=False):
        controller = AnyController(settings_for(firmware, tmp_path / 'controller'))
        for _ in range(2):
            controller.open()
            assert controller.poll().firmware == features.NAMES[firmware]
            controller.close()


def test_controller_without_any_banner(tmp_path, monkeypatch):
    monkeypatch.setattr('ivfmc_ros.devices.detection._GREETING_S', 0.3)
    with emulated('grblhal', tmp_path, auto_reset=False, banner=''):
        controller = AnyController(settings_for('grblhal', tmp_path / 'controller'))
        controller.open()
        assert controller.poll().firmware == 'grblHAL'
        controller.stop()
        assert controller.poll().alarm is None
        controller.close()


def test_two_banners_are_one_start(tmp_path):
    with emulated('grblhal', tmp_path) as emulator:
        emulator.machine.banner *= 2
        controller = AnyController(settings_for('grblhal', tmp_path / 'controller'))
        controller.open()
        assert controller.poll().alarm is None
        controller.close()


@pytest.mark.parametrize('firmware', ['fluidnc', 'marlin', 'fabscan'])
def test_line_that_is_not_understood_is_counted_and_no_error(firmware, tmp_path):
    with connected(firmware, tmp_path) as rig:
        for number in (1, 22, 333):
            rig.emulator.fault(f'say Wifi signal is {number} dBm')
        rig.emulator.fault('noise')
        rig.emulator.fault('half')
        rig.emulator.fault('say')
        rig.emulator.fault('long')
        kind = 'Wifi signal is # dBm'
        rig.until(lambda: rig.controller.unknown_lines().get(kind) == 3, 1.0)
        rig.go(0.05)
        state = rig.arrive()
        assert state.alarm is None
        assert rig.true_position() == pytest.approx(0.05, abs=2 * features.HALF_STEP)


def test_unknown_firmware_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr('ivfmc_ros.devices.detection._GREETING_S', 0.5)
    with emulated('marlin', tmp_path) as emulator:
        emulator.machine._greet = lambda now: emulator.machine._say('Repetier_1.0\r\n')
        emulator.machine._execute = lambda line, now: None
        controller = AnyController(settings_for('marlin', tmp_path / 'controller'))
        with pytest.raises(ControllerLostError, match='Repetier_1'):
            controller.open()
