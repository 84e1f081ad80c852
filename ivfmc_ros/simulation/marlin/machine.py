# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Emulation of a controller with Marlin 2.1: bytes in, bytes out, one axis, two fans.

Written from the descriptions of G-codes at marlinfw.org. Fans change when the moves that are
queued before have ended, though ``ok`` comes at once; ``M410`` is executed when its line has come
(EMERGENCY_PARSER); ``echo:busy`` comes every two seconds while a command waits.
"""

from collections.abc import Callable
from dataclasses import replace
import math
import re

from ivfmc_ros.devices.motion.trajectory import Trajectory
from ivfmc_ros.simulation.laser_outputs import LaserOutputs
from ivfmc_ros.simulation.line_machine import Condition
from ivfmc_ros.simulation.line_machine import LineMachine

# 200 x 16 microsteps and a gear of 18, as the bench table: 160 steps per degree.
_SETTINGS = {100: 160.0, 110: 7200.0, 120: 360.0, 22: 0.0, 25: 3600.0, 27: 0.0}
_BUSY_S = 2.0
_FULL_POWER = 255.0
_GREETING = (
    'start\r\necho: External Reset\r\nMarlin 2.1.2.1\r\n\r\necho: Last Updated: 2022-06-04 | '
    'Author: (none)\r\necho: Free Memory: 3764  PlannerBufferBytes: 1168\r\n'
    'echo:SD init fail\r\nsome line of a vendor\r\n'
)
_FIRMWARE = (
    'FIRMWARE_NAME:Marlin 2.1.2.1 (Jun  4 2022 12:00:00) SOURCE_CODE_URL:github.com/MarlinFirmware'
    '/Marlin PROTOCOL_VERSION:1.0 MACHINE_TYPE:Turntable EXTRUDER_COUNT:1\r\n'
    'Cap:SERIAL_XON_XOFF:0\r\nCap:EMERGENCY_PARSER:1\r\n'
)
_WORD = re.compile(r'([A-Z])(-?\d*\.?\d+)?')


class MarlinMachine(LineMachine):
    """The controller; positions of the axis are degrees."""

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
        self._busy_at = math.inf
        self._feed = 600.0
        self._halted = False
        self._wanted: list[LaserOutputs] = []
        self._line = bytearray()
        self._emergency = False

    @property
    def next_event(self) -> float:
        """Time at which ``advance`` has something to do, infinite if it waits for bytes."""
        return min(super().next_event, self._busy_at)

    def alarm(self, number: int, now: float) -> None:
        """Halt, as after an endstop error; only a reset ends it."""
        self.axis.kill(now)
        self._say('Error:Printer halted. kill() called!\r\n')
        self._halted, self._wait = True, None
        self._outputs = LaserOutputs()
        self._wanted.clear()

    def advance(self, now: float) -> None:
        """Do everything that is due until ``now``."""
        if self._wait is not None and now >= self._busy_at:
            self._say('echo:busy: processing\r\n')
            self._busy_at = now + _BUSY_S
        super().advance(now)
        if self._wanted and self.axis.drained:
            self._outputs = self._wanted[-1]
            self._wanted.clear()
            self._show(now)

    def _greet(self, now: float) -> None:
        self._halted = False
        self._wanted.clear()
        self._say(_GREETING)

    def _receive(self, byte: int) -> None:
        super()._receive(byte)
        self._line.append(byte)
        if byte == ord('\n'):
            self._emergency = self._emergency or self._line.strip() == b'M410'
            self._line.clear()

    def feed(self, data: bytes, now: float) -> None:
        """Receive bytes; M410 acts at once."""
        self._emergency = False
        super().feed(data, now)
        if self._emergency and not self._halted:
            self.axis.kill(now)
            self.advance(now)

    def _finish(self, now: float) -> None:
        self._busy_at = math.inf
        self._say('' if self._halted else 'ok\r\n')

    def _execute(self, line: str, now: float) -> Condition | None:
        words = _WORD.findall(line.partition(';')[0].upper())
        if not words or self._halted:
            return None
        code = ''.join(words[0])
        values = {letter: float(text or 0.0) for letter, text in words[1:]}
        execute = self._codes.get(code)
        if execute is None:
            self._say(f'echo:Unknown command: "{line}"\r\n')
            return None
        self._busy_at = now + _BUSY_S
        return execute(values, now)

    @property
    def _codes(self) -> dict[str, Callable[[dict[str, float], float], Condition | None]]:
        nothing = dict.fromkeys(
            ('G21', 'G90', 'M17', 'M18', 'M211', 'M201', 'M203'), lambda values, now: None
        )
        return {
            **nothing,
            'G0': self._move,
            'G1': self._move,
            'G4': lambda values, now: lambda later: self.axis.drained,
            'G28': self._home,
            'M106': lambda values, now: self._fan(values, values.get('S', _FULL_POWER)),
            'M107': lambda values, now: self._fan(values, 0.0),
            'M3': lambda values, now: None,
            'M5': lambda values, now: None,
            'M114': lambda values, now: self._say(self._position(now)),
            'M115': lambda values, now: self._say(_FIRMWARE),
            'M204': lambda values, now: self.settings.update({120: values['P']}),
            'M400': lambda values, now: lambda later: self.axis.drained,
            'M410': lambda values, now: None,
            'M503': lambda values, now: self._say(self._listing()),
        }

    def _move(self, values: dict[str, float], now: float) -> Condition | None:
        self._feed = values.get('F', self._feed)
        if 'X' in values:
            self.axis.queue_move(values['X'], relative=False, feed=self._feed)
        return (lambda later: not self.axis.planner_full) if self.axis.planner_full else None

    def _home(self, values: dict[str, float], now: float) -> Condition:
        self.axis.home(now)
        return lambda later: self.axis.state != 'Home'

    def _fan(self, values: dict[str, float], power: float) -> None:
        before = self._wanted[-1] if self._wanted else self._outputs
        number = int(values.get('P', 0.0))
        if number == 0:
            self._wanted.append(replace(before, spindle=power / _FULL_POWER))
        elif number == 1:
            self._wanted.append(replace(before, coolant=power / _FULL_POWER))

    def _position(self, now: float) -> str:
        steps = round(self.axis.state_at(now)[0] * self.settings[100])
        return f'X:{self.axis.target:.2f} Y:0.00 Z:0.00 E:0.00 Count X:{steps} Y:0 Z:0\r\n'

    def _listing(self) -> str:
        return (
            'echo:; Linear Units:\r\necho:  G21 ; (mm)\r\necho:; Steps per unit:\r\n'
            f'echo: M92 X{self.settings[100]:.2f} Y80.00 Z400.00 E93.00\r\n'
            'echo:; Max feedrates (units/s):\r\n'
            f'echo:  M203 X{self.settings[110] / 60:.2f} Y300.00 Z5.00 E25.00\r\n'
            'echo:; Max Acceleration (units/s2):\r\n'
            f'echo:  M201 X{_SETTINGS[120]:.2f} Y3000.00 Z100.00 E10000.00\r\n'
        )
