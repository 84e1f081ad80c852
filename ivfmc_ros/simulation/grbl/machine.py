# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A GRBL 1.1 board as a state machine in time: bytes in, bytes out, one axis, two outputs."""

from collections.abc import Callable
import math
import re

from ivfmc_ros.devices.motion.ramp import Motion
from ivfmc_ros.simulation.grbl import gcode
from ivfmc_ros.simulation.grbl.axis import GrblAxis
from ivfmc_ros.simulation.grbl.gcode import Block
from ivfmc_ros.simulation.grbl.gcode import LineError
from ivfmc_ros.simulation.grbl.modes import Modes
from ivfmc_ros.simulation.grbl.modes import Outputs
from ivfmc_ros.simulation.grbl.report import Reporter

BANNER = "\r\nGrbl 1.1h ['$' for help]\r\n"
RX_ROOM = 127  # bytes that wait to be read
LINE_ROOM = 79  # characters of a line

# A rotary table with 200 x 16 microsteps and a gear of 18: 160 steps a degree.
SETTINGS: dict[int, float] = {
    **{0: 10, 1: 255, 2: 0, 3: 0, 4: 0, 5: 0, 6: 0, 10: 1, 11: 0.01, 12: 0.002, 13: 0},
    **{20: 0, 21: 0, 22: 0, 23: 0, 24: 300, 25: 1800, 26: 250, 27: 1.0},
    **{30: 1000, 31: 0, 32: 0},
    **{100: 160, 101: 250, 102: 250, 110: 7200, 111: 500, 112: 500},
    **{120: 360, 121: 10, 122: 10, 130: 200, 131: 200, 132: 200},
}
_HOMING_ENABLED = 22
_SETTING = re.compile(r'(\d+)=(-?\d+\.?\d*)')

# The board waits; the function tells at a time whether it has waited enough.
_Wait = Callable[[float], bool]


class GrblMachine:
    """
    The board. Times are seconds of any steady clock, positions are board units (degrees).

    on_motion : called with each new motion of the shaft, see GrblAxis
    on_outputs : called with the time and the outputs when these change
    clock_scale : board seconds in a second; a ceramic resonator is good to 0.5 %
    """

    def __init__(
        self,
        *,
        on_motion: Callable[[float, Motion], None],
        on_outputs: Callable[[float, Outputs], None],
        clock_scale: float = 1.0,
    ) -> None:
        self.settings = dict(SETTINGS)
        self.axis = GrblAxis(self.settings, on_motion, clock_scale)
        self._on_outputs = on_outputs
        self._outputs = Outputs()
        self._out = bytearray()
        self._on = False
        self._locked = self._critical = self._asked = False
        self._rx = bytearray()
        self._waits: _Wait | None = None
        self._dwell_until = math.inf
        self._modes, self._report = Modes(), Reporter()

    # -- power and the serial line

    def power_on(self, now: float) -> None:
        """Start, or start again, which makes the present position 0."""
        self.axis.kill(now)
        self.axis.zero()
        self._forget()
        self._on = True
        self._locked = bool(self.settings[_HOMING_ENABLED])
        self._greet(now)

    def feed(self, data: bytes, now: float) -> None:
        """Take what was sent to the board."""
        if not self._on:
            return
        self.advance(now)
        for byte in data:
            realtime = self._realtime.get(byte)
            if realtime is not None:
                realtime(now)
            elif byte < 0x80 and len(self._rx) < RX_ROOM:
                self._rx.append(byte)
        self.advance(now)

    def advance(self, now: float) -> None:
        """Do all that is due."""
        while self._on and (self.axis.advance(now) or self._advance_lines(now)):
            self._switch_outputs(now)
        self._switch_outputs(now)

    def take_output(self) -> bytes:
        """Return what the board has sent since the last call."""
        out = bytes(self._out)
        self._out.clear()
        return out

    @property
    def due(self) -> float:
        """When ``advance`` has something to do, infinite if it waits for the other side."""
        return min(self.axis.due, self._dwell_until)

    def alarm(self, number: int, now: float) -> None:
        """Raise an alarm, as a limit switch does."""
        self.axis.kill(now)
        self._forget()
        self._locked = True
        self._say(f'ALARM:{number}\r\n')
        if number in (1, 2):
            self._say('[MSG:Reset to continue]\r\n')
            self._critical = True
        self._switch_outputs(now)

    # -- realtime bytes

    @property
    def _state(self) -> str:
        if self._locked:
            return 'Alarm'
        if self.axis.state == 'Hold':
            return f'Hold:{int(not self.axis.held)}'
        return self.axis.state

    @property
    def _realtime(self) -> dict[int, Callable[[float], None]]:
        return {
            ord('?'): self._question,
            ord('!'): self._hold,
            ord('~'): self._resume,
            0x18: self._reset,
        }

    def _question(self, now: float) -> None:
        if self._critical:
            return
        if self.axis.state == 'Home':
            self._asked = True  # answered when it is there
            return
        position, velocity = self.axis.at(now)
        outputs = self._lit()
        self._say(
            self._report.line(
                state=self._state,
                position=position,
                feed=abs(velocity) * 60,
                rpm=self._modes.speed if outputs.spindle else 0.0,
                outputs=self._modes.letters(outputs),
                busy=self.axis.state != 'Idle',
            )
        )

    def _hold(self, now: float) -> None:
        if not self._locked:
            self.axis.hold(now)

    def _resume(self, now: float) -> None:
        self.axis.resume(now)

    def _reset(self, now: float) -> None:
        homing, locked = self.axis.state == 'Home', self._locked and not self._critical
        moved = self.axis.kill(now)
        self._forget()
        self._locked = moved or locked
        if moved:
            self._say(f'ALARM:{6 if homing else 3}\r\n')
        self._greet(now)

    def _greet(self, now: float) -> None:
        self._say(BANNER)
        if self._locked:
            self._say("[MSG:'$H'|'$X' to unlock]\r\n")
        self._switch_outputs(now)

    # -- lines

    def _advance_lines(self, now: float) -> bool:
        """Do one line, or a part of it; tell whether there may be more to do."""
        if self.axis.state == 'Hold' or self._critical:
            return False
        if self._waits is not None:
            if not self._waits(now):
                return self.axis.start(now)
            self._waits, self._dwell_until = None, math.inf
            self._say('ok\r\n')
            return True
        text, found, rest = bytes(self._rx).replace(b'\r', b'\n').partition(b'\n')
        if not found:
            return self.axis.start(now)
        self._rx = bytearray(rest)
        self._execute(gcode.clean(text.decode('ascii', 'replace')), now)
        return True

    def _execute(self, line: str, now: float) -> None:
        try:
            if len(line) > LINE_ROOM:
                raise LineError(11)
            if line.startswith('$'):
                self._system(line[1:], now)
            elif line and self._locked:
                raise LineError(9)
            else:
                self._run(gcode.read_block(line))
        except LineError as error:
            self._say(f'error:{error.number}\r\n')
            return
        if self._waits is None:
            self._say('ok\r\n')

    def _run(self, block: Block) -> None:
        self._modes.take(block)
        codes = dict(block.codes)
        if codes.get('end') in ('M2', 'M30'):
            codes.update(spindle='M5', coolant='M9')
            self._say('[MSG:Pgm End]\r\n')
        if codes.get('dwell') == 'G4':
            self._waits = self._dwell(block.values['P'])
            return
        if 'spindle' in codes or 'coolant' in codes:
            self._waits = lambda now: self.axis.drained and self._switch(codes)
        if 'X' in block.values:
            feed = None if self._modes.motion == 'G0' else self._modes.feed
            relative = self._modes.distance == 'G91'
            self.axis.queue(block.values['X'], relative, feed)
            if self.axis.crowded and self._waits is None:
                self._waits = lambda now: not self.axis.crowded

    def _switch(self, codes: dict[str, str]) -> bool:
        self._modes.switch(codes)
        self._report.refresh()
        return True

    def _dwell(self, seconds: float) -> _Wait:
        def over(now: float) -> bool:
            if self.axis.drained and self._dwell_until == math.inf:
                self._dwell_until = now + seconds
            return now >= self._dwell_until

        return over

    def _system(self, command: str, now: float) -> None:
        setting = _SETTING.fullmatch(command)
        if setting:
            self._set(int(setting[1]), float(setting[2]))
        elif command == 'H':
            self._home(now)
        elif command == 'X':
            self._say('[MSG:Caution: Unlocked]\r\n' if self._locked else '')
            self._locked = False
        elif command == '$' and self.axis.state != 'Idle':
            raise LineError(8)
        elif command in self._texts:
            self._say(self._texts[command]())
        else:
            raise LineError(3 if command[:1].isdecimal() else 2)

    @property
    def _texts(self) -> dict[str, Callable[[], str]]:
        return {
            '': self._report.help,
            '$': lambda: self._report.settings(self.settings),
            'I': lambda: '[VER:1.1h.20190830:]\r\n[OPT:V,15,128]\r\n',
            'G': self._modes.text,
        }

    def _home(self, now: float) -> None:
        if not self.settings[_HOMING_ENABLED]:
            raise LineError(5)
        if self.axis.state != 'Idle':
            raise LineError(8)
        self._locked = False
        self.axis.home(now)
        self._waits = self._homed

    def _homed(self, now: float) -> bool:
        if self.axis.state == 'Home':
            return False
        if self._asked:
            self._asked = False
            self._question(now)
        return True

    def _set(self, number: int, value: float) -> None:
        if self.axis.state != 'Idle':
            raise LineError(8)
        if number not in self.settings:
            raise LineError(3)
        if value < 0:
            raise LineError(4)
        self.settings[number] = value

    # -- outputs

    def _lit(self) -> Outputs:
        return self._modes.outputs(self.settings, self.axis.state == 'Run', self.axis.held)

    def _switch_outputs(self, now: float) -> None:
        outputs = self._lit()
        if outputs != self._outputs:
            self._outputs = outputs
            self._on_outputs(now, outputs)

    def _forget(self) -> None:
        """Begin as after a reset."""
        self._rx = bytearray()
        self._waits = None
        self._dwell_until = math.inf
        self._critical = self._asked = False
        self._modes, self._report = Modes(), Reporter()

    def _say(self, text: str) -> None:
        self._out += text.encode('ascii')
