# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Faults of a motion controller behind the driver of the turntable: what it does, and how soon.

In each case a laser is on and the table moves (unless it stands in the case), the fault happens,
and the driver has to say its code with the beam off; then it is told to go on, and a move and a
laser have to work.
"""

from collections.abc import Callable
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
import time

from ivfmc_ros.devices.any_controller import AnyController
from ivfmc_ros.devices.beam import BeamInterlock
from ivfmc_ros.devices.beam import BeamSettings
from ivfmc_ros.devices.controller import CONTROLLER_LOST
from ivfmc_ros.devices.controller import fault_code
from ivfmc_ros.devices.turntable import TurntableDriver
from ivfmc_ros.errors import ControllerLostError
from ivfmc_ros.simulation.controller_emulator import ControllerEmulator
from support.controllers import emulated
from support.controllers import settings_for

PERIOD_S = 0.005
FIRMWARE = 'grbl'


@dataclass(frozen=True, kw_only=True)
class FaultCase:
    """
    A fault and what is expected.

    codes : of which the driver says one; '' for a fault that is no fault to the driver
    moving : whether it happens in a move
    automatic : the driver goes on by itself; otherwise clear_alarm is called
    after : fault that ends the fault, such as ``plug``
    """

    name: str
    fault: str
    codes: tuple[str, ...]
    moving: bool = True
    automatic: bool = False
    after: str = ''


LOST = ('CONTROLLER_LOST',)
POSITION = ('POSITION_LOST',)
ALARM = ('CONTROLLER_ALARM',)
CASES = (
    FaultCase(
        name='unplugged idle',
        fault='unplug',
        codes=LOST,
        moving=False,
        automatic=True,
        after='plug',
    ),
    FaultCase(
        name='unplugged in a move', fault='unplug', codes=LOST, automatic=True, after='plug'
    ),
    # the reset that turns the laser off also loses the position of a table that moves
    FaultCase(name='silence in a move', fault='silence 2.5', codes=LOST),
    FaultCase(name='silence', fault='silence 2.5', codes=LOST, automatic=True, moving=False),
    FaultCase(name='restart in a move', fault='reset', codes=POSITION),
    FaultCase(name='restart idle', fault='reset', codes=POSITION, moving=False),
    *(
        FaultCase(name=f'alarm {number}', fault=f'alarm {number}', codes=ALARM)
        for number in (1, 2, 3, 8)
    ),
    FaultCase(name='safety door', fault='door', codes=ALARM),
    FaultCase(name='garbage', fault='noise', codes=('',), automatic=True),
    FaultCase(name='half a line', fault='half', codes=('',), automatic=True),
    FaultCase(name='over-long line', fault='long', codes=('',), automatic=True),
    FaultCase(name='unknown line', fault='say foo', codes=('',), automatic=True),
    FaultCase(name='stray ok', fault='say ok', codes=('',), automatic=True),
    FaultCase(name='stray error', fault='say error:20', codes=('',), automatic=True),
)


@dataclass(frozen=True, kw_only=True)
class FaultOutcome:
    """
    What the driver did.

    code : as diagnostics have it; '' for none
    detected_s, dark_s : seconds from the fault until the code, and until the beam was off
    recovered_s : seconds from the end of the fault, or from clear_alarm, until it is ready
    good : a laser and a move worked afterwards
    """

    code: str
    detected_s: float
    dark_s: float
    recovered_s: float
    good: bool


class DriverRig:
    """A driver with reconnection, and its emulated controller."""

    def __init__(self, emulator: ControllerEmulator, port: Path) -> None:
        self.emulator = emulator
        self.driver = TurntableDriver(
            AnyController(settings_for(FIRMWARE, port)),
            BeamInterlock(('left', 'right'), BeamSettings()),
            velocity=2.0,
            reconnect=True,
        )
        self.driver.start()
        self.until(lambda: not self.driver.fault)

    def shining(self) -> bool:
        outputs = self.emulator.machine.present_outputs()
        return outputs.spindle > 0.0 or outputs.coolant > 0.0

    def until(self, condition: Callable[[], bool], seconds: float = 8.0, hold: str = '') -> float:
        """Wait; a laser is held meanwhile. The result is the number of seconds."""
        start = time.monotonic()
        while not condition():
            if hold:
                self.driver.hold(hold)
            if time.monotonic() - start > seconds:
                raise AssertionError(f'not within {seconds} s: {self.driver.state()}')
            time.sleep(PERIOD_S)
        return time.monotonic() - start

    def light(self) -> None:
        self.driver.hold('')
        self.until(self.shining, 4.0, hold='left')

    def is_good(self) -> bool:
        """Whether a laser lights and a move ends at its target."""
        try:
            self.light()
            target = self.driver.state().position + 0.1
            self.driver.command(target, 0.0)
            self.until(lambda: abs(self.driver.state().position - target) < 1e-3, 4.0, hold='left')
        except AssertionError:
            return False
        return True


@contextmanager
def driver_rig(folder: Path) -> Iterator[DriverRig]:
    with emulated(FIRMWARE, folder) as emulator:
        rig = DriverRig(emulator, folder / 'controller')
        try:
            yield rig
        finally:
            rig.driver.close()


def outcome(case: FaultCase, folder: Path) -> FaultOutcome:
    """Run a case."""
    with driver_rig(folder) as rig:
        rig.light()
        if case.moving:
            rig.driver.command(rig.driver.state().position + 20.0, 40.0)
            rig.until(lambda: rig.driver.state().moving, hold='left')
        rig.emulator.fault(case.fault)
        start = time.monotonic()
        code = _await_code(rig, case, start)
        detected = time.monotonic() - start
        dark = detected
        if code:
            dark += rig.until(lambda: not rig.shining(), 4.0, hold='left')
        recovered = _recover(rig, case, code)
        return FaultOutcome(
            code=code,
            detected_s=detected,
            dark_s=dark if code else 0.0,
            recovered_s=recovered,
            good=rig.is_good(),
        )


def _await_code(rig: DriverRig, case: FaultCase, start: float) -> str:
    """Return the code that the driver says, '' if it says none for a second."""
    patience = 3.0 if case.codes[0] else 1.0
    while time.monotonic() - start < patience:
        rig.driver.hold('left')
        if code := fault_code(rig.driver.state().alarm):
            return code
        time.sleep(PERIOD_S)
    return ''


def _recover(rig: DriverRig, case: FaultCase, code: str) -> float:
    start = time.monotonic()
    if case.after:
        rig.emulator.fault(case.after)
    if not case.automatic:
        # a lost controller is connected again first
        rig.until(lambda: rig.driver.state().alarm != CONTROLLER_LOST)
        rig.driver.clear_alarm()
    rig.until(lambda: rig.driver.state().alarm is None)
    seconds = time.monotonic() - start
    if not code:
        # the table still moves
        rig.driver.stop()
    return seconds


def refused(folder: Path, case: str) -> str:
    """Return the error of a controller that cannot be connected: taken, wrong, wrong baud rate."""
    if case == 'taken':
        with driver_rig(folder):
            return _error_of(AnyController(settings_for(FIRMWARE, folder / 'controller')))
    with emulated('marlin', folder) as emulator:
        text = 'Repetier_1.0\r\n' if case == 'wrong controller' else '\x80\xfe\x01\x80'
        emulator.machine._greet = lambda now: emulator.machine._say(text)
        emulator.machine._execute = lambda line, now: None
        emulator.machine._finish = lambda now: emulator.machine._say(text)
        return _error_of(AnyController(settings_for(FIRMWARE, folder / 'controller')))


def _error_of(controller: AnyController) -> str:
    try:
        controller.open()
    except ControllerLostError as error:
        return str(error)
    finally:
        controller.close()
    return ''
