# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Each firmware connects, moves, lights, stops, recovers and homes, against its emulator."""

import math
import time

import pytest
from support.controllers import connected
from support.controllers import emulated
from support.controllers import FIRMWARES
from support.controllers import settings_for

from ivfmc_ros.devices.any_controller import AnyController
from ivfmc_ros.errors import ControllerLostError
from ivfmc_ros.errors import ControllerRefusedError

# Half a step of the coarsest motor: 3200 steps a turn.
HALF_STEP = math.pi / 3200
GRBL_FAMILY = ('grbl', 'grbl-0.9', 'grblhal', 'fluidnc', 'horus')
NAMES = {
    'grbl': 'Grbl 1.1h',
    'grbl-0.9': 'Grbl 0.9j',
    'grblhal': 'grblHAL 1.1f',
    'fluidnc': 'FluidNC 3.7',
    'horus': 'Horus 0.2',
    'marlin': 'Marlin 2.1.2.1',
    'fabscan': 'FabScan 2.0.5',
}


@pytest.fixture(params=FIRMWARES)
def rig(request, tmp_path):
    with connected(request.param, tmp_path) as rig:
        yield rig


def test_connects_moves_and_lights(rig):
    state = rig.controller.poll()
    assert (state.firmware, state.alarm, state.homed) == (NAMES[rig.firmware], None, False)
    for target in (0.15, 0.05):
        rig.go(target)
        assert rig.controller.poll().moving
        assert rig.arrive().position == pytest.approx(target, abs=2 * HALF_STEP)
        assert rig.true_position() == pytest.approx(target, abs=HALF_STEP)
    for laser, shining in (
        ('left', (True, False)),
        ('right', (False, True)),
        (None, (False,) * 2),
    ):
        rig.controller.set_laser(laser)
        rig.until(lambda shining=shining: rig.shining() == shining, 1.0)
        lit = [name for name, on in rig.controller.poll().lasers.items() if on]
        assert lit == ([laser] if laser else [])


def test_stops_in_a_move_and_goes_on_from_there(rig):
    rig.controller.set_laser('left')
    rig.until(lambda: rig.shining() == (True, False), 1.0)
    rig.go(3.0, 0.8)
    time.sleep(0.4)
    rig.controller.stop()
    state = rig.controller.poll()
    assert (state.moving, state.alarm) == (False, None)
    rig.until(lambda: rig.shining() == (False, False), 1.0)
    assert 0.01 < state.position < 2.0
    assert state.position == pytest.approx(rig.true_position(), abs=2 * HALF_STEP)
    target = state.position + 0.05
    rig.go(target)
    rig.arrive()
    assert rig.true_position() == pytest.approx(target, abs=2 * HALF_STEP)


@pytest.mark.parametrize('rig', ['grblhal', 'marlin', 'fabscan'], indirect=True)
def test_recovers_from_a_silence(rig):
    rig.emulator.fault('silence 4.5')
    rig.until(lambda: rig.controller.poll().alarm is not None, 4.2)
    assert rig.controller.poll().alarm == 'CONTROLLER_LOST'
    time.sleep(2.0)
    rig.controller.clear_alarm()
    assert rig.controller.poll().alarm is None
    before = rig.true_position()
    rig.go(rig.controller.poll().position + 0.05)
    rig.arrive()
    assert rig.true_position() - before == pytest.approx(0.05, abs=2 * HALF_STEP)


@pytest.mark.parametrize('firmware', ['grbl', 'grbl-0.9', 'grblhal', 'fluidnc', 'marlin'])
def test_homes_where_it_can(firmware, tmp_path):
    with emulated(firmware, tmp_path, homing=True) as emulator:
        axis = getattr(emulator.machine, 'firmware', None)
        index = axis.index if axis else 0
        emulator.machine.settings.update({25: 36000.0, 110 + index: 36000.0, 120 + index: 3600.0})
        controller = AnyController(settings_for(firmware, tmp_path / 'controller'))
        controller.open()
        assert not controller.poll().homed
        controller.home()
        assert (controller.poll().homed, controller.poll().alarm) == (True, None)
        controller.close()


@pytest.mark.parametrize('firmware', ['horus', 'fabscan'])
def test_firmware_without_a_home_switch_says_so(firmware, tmp_path):
    with connected(firmware, tmp_path) as rig, pytest.raises(ControllerRefusedError):
        rig.controller.home()


@pytest.mark.parametrize('firmware', ['grblhal', 'fluidnc'])
def test_rotary_axis_is_taken_where_there_is_one(firmware, tmp_path):
    with connected(firmware, tmp_path) as rig:
        assert rig.emulator.machine.firmware.axis == 'A'
        rig.go(0.1)
        rig.arrive()
        assert rig.true_position() == pytest.approx(0.1, abs=HALF_STEP)


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
def test_port_that_does_not_reset_the_controller(firmware, tmp_path):
    with emulated(firmware, tmp_path, auto_reset=False):
        controller = AnyController(settings_for(firmware, tmp_path / 'controller'))
        for _ in range(2):
            controller.open()
            assert controller.poll().firmware == NAMES[firmware]
            controller.close()


def test_controller_without_any_banner(tmp_path):
    with emulated('grblhal', tmp_path, auto_reset=False) as emulator:
        emulator.machine.banner = ''
        controller = AnyController(settings_for('grblhal', tmp_path / 'controller'))
        controller.open()
        assert controller.poll().firmware == 'grblHAL'
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
        assert rig.true_position() == pytest.approx(0.05, abs=2 * HALF_STEP)


def test_unknown_firmware_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr('ivfmc_ros.devices.detection._GREETING_S', 0.5)
    with emulated('marlin', tmp_path) as emulator:
        emulator.machine._greet = lambda now: emulator.machine._say('Repetier_1.0\r\n')
        emulator.machine._execute = lambda line, now: None
        controller = AnyController(settings_for('marlin', tmp_path / 'controller'))
        with pytest.raises(ControllerLostError, match='Repetier_1'):
            controller.open()
