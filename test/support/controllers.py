# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""An emulated motion controller of any firmware, and the driver for it."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
import math
from pathlib import Path
import time
from typing import Any

from ivfmc_ros.devices.any_controller import AnyController
from ivfmc_ros.devices.controller import ControllerState
from ivfmc_ros.devices.controller import MotionController
from ivfmc_ros.devices.settings import ControllerSettings
from ivfmc_ros.simulation.controller_emulator import ControllerEmulator

# Outputs of the two lasers by the emulated firmware; units of a turn that are no degrees.
GRBL_LASERS = {'left': 'spindle', 'right': 'coolant'}
PIN_LASERS = {'left': 'laser1', 'right': 'laser2'}
LASERS = {
    'grbl': GRBL_LASERS,
    'grbl-0.9': GRBL_LASERS,
    'grblhal': GRBL_LASERS,
    'fluidnc': GRBL_LASERS,
    'horus': PIN_LASERS,
    'marlin': {'left': 'fan0', 'right': 'fan1'},
    'fabscan': PIN_LASERS,
}
UNITS = {'fabscan': 3200.0}
FIRMWARES = tuple(LASERS)


@dataclass
class Rig:
    """Emulator and connected driver."""

    firmware: str
    emulator: ControllerEmulator
    controller: MotionController

    def go(self, position: float, speed: float = 2.0) -> None:
        limits = self.controller.limits()
        speed = min(speed, limits.velocity)
        self.controller.move_to(position, speed, limits.acceleration)

    def arrive(self, seconds: float = 15.0) -> ControllerState:
        self.until(lambda: not self.controller.poll().moving, seconds)
        return self.controller.poll()

    def until(self, condition: Any, seconds: float = 5.0) -> float:
        """Wait for a condition; the result is the number of seconds."""
        start = time.monotonic()
        while not condition():
            if time.monotonic() - start > seconds:
                raise AssertionError(f'not within {seconds} s: {self.controller.poll()}')
            time.sleep(0.005)
        return time.monotonic() - start

    def true_position(self) -> float:
        """Position of the table, radians, from the start of the emulator on."""
        units = self.emulator.machine.axis.state_at(time.monotonic())[0]
        return 2 * math.pi * units / UNITS.get(self.firmware, 360.0)

    def shining(self) -> tuple[bool, bool]:
        """Which outputs are on in truth."""
        outputs = self.emulator.machine.present_outputs()
        return outputs.spindle > 0.0, outputs.coolant > 0.0


def settings_for(firmware: str, port: Path, **changes: Any) -> ControllerSettings:
    return ControllerSettings(
        port=str(port),
        lasers=LASERS[firmware],
        units_per_turn=UNITS.get(firmware, 360.0),
        **changes,
    )


@contextmanager
def emulated(
    firmware: str, folder: Path, *, banner: str | None = None, **options: Any
) -> Iterator[ControllerEmulator]:
    """Run an emulated controller at the port ``folder/controller``, with another banner if any."""
    emulator = ControllerEmulator(folder / 'controller', firmware=firmware, seed=1, **options)
    if banner is not None:
        emulator.machine.banner = banner
    emulator.start()
    try:
        yield emulator
    finally:
        emulator.stop()


@contextmanager
def connected(firmware: str, folder: Path, **options: Any) -> Iterator[Rig]:
    """Run an emulated controller and connect the driver, which finds out the firmware."""
    with emulated(firmware, folder, **options) as emulator:
        controller = AnyController(settings_for(firmware, folder / 'controller'))
        try:
            controller.open()
            yield Rig(firmware, emulator, controller)
        finally:
            controller.close()
