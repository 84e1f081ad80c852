# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a motion controller has to do, one function a feature, against its emulator."""

from collections.abc import Callable
import math
from pathlib import Path
import time

from ivfmc_ros.devices.any_controller import AnyController
from ivfmc_ros.errors import ControllerRefusedError
from support.controllers import connected
from support.controllers import emulated
from support.controllers import Rig
from support.controllers import settings_for

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
WITHOUT_HOME = ('horus', 'fabscan')


def connects(rig: Rig) -> None:
    state = rig.controller.poll()
    assert (state.firmware, state.alarm, state.homed) == (NAMES[rig.firmware], None, False)


def moves(rig: Rig) -> None:
    for target in (0.15, 0.05):
        rig.go(target)
        assert rig.controller.poll().moving
        assert abs(rig.arrive().position - target) < 2 * HALF_STEP
        assert abs(rig.true_position() - target) < 1.1 * HALF_STEP


def lights(rig: Rig) -> None:
    for laser in ('left', 'right', None):
        shining = laser == 'left', laser == 'right'
        rig.controller.set_laser(laser)
        rig.until(lambda shining=shining: rig.shining() == shining, 1.0)
        lit = [name for name, on in rig.controller.poll().lasers.items() if on]
        assert lit == ([laser] if laser else [])


def stops(rig: Rig) -> None:
    """A stop in a move turns the laser off, and the move goes on from where it stopped."""
    rig.controller.set_laser('left')
    rig.until(lambda: rig.shining() == (True, False), 1.0)
    start = rig.controller.poll().position
    rig.go(start + 3.0, 0.8)
    time.sleep(0.4)
    rig.controller.stop()
    state = rig.controller.poll()
    assert (state.moving, state.alarm) == (False, None)
    rig.until(lambda: rig.shining() == (False, False), 1.0)
    assert 0.01 < state.position - start < 2.0
    assert abs(state.position - rig.true_position()) < 2 * HALF_STEP
    target = state.position + 0.05
    rig.go(target)
    rig.arrive()
    assert abs(rig.true_position() - target) < 2 * HALF_STEP


def recovers(rig: Rig) -> None:
    """After a silence the driver is lost until it is told to connect again."""
    rig.emulator.fault('silence 4.5')
    rig.until(lambda: rig.controller.poll().alarm is not None, 4.2)
    assert rig.controller.poll().alarm == 'CONTROLLER_LOST'
    time.sleep(2.0)
    rig.controller.clear_alarm()
    assert rig.controller.poll().alarm is None
    before = rig.true_position()
    rig.go(rig.controller.poll().position + 0.05)
    rig.arrive()
    assert abs(rig.true_position() - before - 0.05) < 2 * HALF_STEP


def homes(firmware: str, folder: Path) -> None:
    """Where the firmware has a home switch; the others say that they have none."""
    if firmware in WITHOUT_HOME:
        with connected(firmware, folder) as rig:
            try:
                rig.controller.home()
            except ControllerRefusedError:
                return
            raise AssertionError('homed without a switch')
    with emulated(firmware, folder, homing=True) as emulator:
        model = getattr(emulator.machine, 'firmware', None)
        index = model.index if model else 0
        fast = {25: 36000.0, 110 + index: 36000.0, 120 + index: 3600.0}
        emulator.machine.settings.update(fast)
        controller = AnyController(settings_for(firmware, folder / 'controller'))
        controller.open()
        assert not controller.poll().homed
        controller.home()
        assert (controller.poll().homed, controller.poll().alarm) == (True, None)
        controller.close()


# Of a controller that is connected; homing needs one with a switch.
FEATURES: dict[str, Callable[[Rig], None]] = {
    'connects': connects,
    'moves': moves,
    'lights': lights,
    'stops': stops,
    'recovers': recovers,
}
