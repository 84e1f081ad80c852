# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Emulation of the firmware of FabScan Pi: bytes in, bytes out, a stepper motor, two lasers.

Written from github.com/mariolukas/FabScanPi-Firmware: no greeting, an echo of each byte, a prompt
after each line, nothing at all while a move runs; a serial buffer of 64 bytes.
"""

from collections.abc import Callable
from dataclasses import replace
import re

from ivfmc_ros.devices.motion.trajectory import Trajectory
from ivfmc_ros.simulation.laser_outputs import LaserOutputs
from ivfmc_ros.simulation.line_machine import Condition
from ivfmc_ros.simulation.line_machine import LineMachine

# Units are steps: 3000 steps/s, 500 steps/s^2, as G02 has them.
_SETTINGS = {100: 1.0, 110: 180_000.0, 120: 500.0, 22: 0.0, 25: 1000.0, 27: 0.0}
_VERSION = '2.0.5'
_CODE = re.compile(r'([GM])0*(\d+)')
_STEPS = re.compile(r' T(-?\d+)')


class FabscanMachine(LineMachine):
    """The controller; positions of the axis are steps."""

    CAPACITY = 64

    def __init__(
        self,
        *,
        on_motion: Callable[[float, Trajectory], None],
        on_outputs: Callable[[float, LaserOutputs], None],
        clock_scale: float = 1.0,
    ) -> None:
        super().__init__(
            _SETTINGS, on_motion=on_motion, on_outputs=on_outputs, clock_scale=clock_scale
        )

    def alarm(self, number: int, now: float) -> None:
        """It has no alarms."""

    def _finish(self, now: float) -> None:
        self._say('>\r\n')

    def _execute(self, line: str, now: float) -> Condition | None:
        self._say(f'{line}\n')
        found = _CODE.match(line.strip())
        code = f'{found[1]}{found[2]}' if found else ''
        steps = _STEPS.search(line)
        if code in ('G0', 'G1', 'G2') and steps:
            # each move counts from where the motor stands, and ramps up and down
            self.axis.queue_move(float(steps[1]), relative=True, feed=None)
            return lambda later: self.axis.drained
        lasers = {'M21': ('spindle', 1.0), 'M22': ('spindle', 0.0)}
        lasers |= {'M19': ('coolant', 1.0), 'M20': ('coolant', 0.0)}
        if code in lasers:
            name, power = lasers[code]
            self._outputs = replace(self._outputs, **{name: power})
        elif code == 'M200':
            self._say(f'{_VERSION}\r\n')
        return None
