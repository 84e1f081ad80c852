# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Emulation of a GRBL 1.1 controller: bytes in, bytes out, one axis, two outputs.

Responses were compared with GRBL 1.1h of 2019-08-30, built from its sources for a computer.
"""

from collections.abc import Callable
import math
import re

from ivfmc_ros.devices.motion.trajectory import Trajectory
from ivfmc_ros.simulation.grbl import gcode
from ivfmc_ros.simulation.grbl.axis import GrblAxis
from ivfmc_ros.simulation.grbl.gcode import GcodeBlock
from ivfmc_ros.simulation.grbl.gcode import GcodeError
from ivfmc_ros.simulation.grbl.modal_state import LaserOutputs
from ivfmc_ros.simulation.grbl.modal_state import ModalState
from ivfmc_ros.simulation.grbl.report import ReportFormatter

BANNER = "\r\nGrbl 1.1h ['$' for help]\r\n"
RX_CAPACITY = 127  # bytes of the receive buffer
MAX_LINE_LENGTH = 79  # characters; longer lines are error 11

# A rotary table with 200 x 16 microsteps and a gear of 18: 160 steps per degree.
SETTINGS: dict[int, float] = {
    **{0: 10, 1: 255, 2: 0, 3: 0, 4: 0, 5: 0, 6: 0, 10: 1, 11: 0.01, 12: 0.002, 13: 0},
    **{20: 0, 21: 0, 22: 0, 23: 0, 24: 300, 25: 1800, 26: 250, 27: 1.0},
    **{30: 1000, 31: 0, 32: 0},
    **{100: 160, 101: 250, 102: 250, 110: 7200, 111: 500, 112: 500},
    **{120: 360, 121: 10, 122: 10, 130: 200, 131: 200, 132: 200},
}
_REPORT_INCHES, _HOMING_ENABLED = 13, 22
_SETTING = re.compile(r'(\d+)=(-?\d+\.?\d*)')

# Returns at a time (seconds) whether the controller need not wait any longer.
_WaitCondition = Callable[[float], bool]


class GrblMachine:
    """
    The controller. Times are steady seconds, positions are controller units (degrees).

    on_motion : called with the time and the trajectory of the table, see GrblAxis
    on_outputs : called with the time and the outputs when these change
    clock_scale : controller seconds per second; a ceramic resonator is good to 0.5 %
    banner : sent at each start
    """

    def __init__(
        self,
        *,
        on_motion: Callable[[float, Trajectory], None],
        on_outputs: Callable[[float, LaserOutputs], None],
        clock_scale: float = 1.0,
    ) -> None:
        self.settings = dict(SETTINGS)
        self.banner = BANNER
        self.axis = GrblAxis(self.settings, on_motion, clock_scale)
        self._on_outputs = on_outputs
        self._outputs = LaserOutputs()
        self._tx = bytearray()
        self._powered = False
        self._locked = self._needs_reset = self._report_pending = False
        self._rx = bytearray()
        self._wait_condition: _WaitCondition | None = None
        self._dwell_until = math.inf
        self._modal_state, self._formatter = ModalState(), ReportFormatter()

    # -- power and the serial line

    def power_on(self, now: float) -> None:
        """Start, or restart; the present position becomes 0."""
        self.axis.kill(now)
        self.axis.reset_origin()
        self._reset_state()
        self._powered = True
        self._locked = bool(self.settings[_HOMING_ENABLED])
        self._send_banner(now)

    def feed(self, data: bytes, now: float) -> None:
        """Receive bytes."""
        if not self._powered:
            return
        self.advance(now)
        for byte in data:
            realtime = self._realtime_commands.get(byte)
            if realtime is not None:
                realtime(now)
            elif byte < 0x80 and len(self._rx) < RX_CAPACITY:
                self._rx.append(byte)
        self.advance(now)

    def advance(self, now: float) -> None:
        """Do everything that is due until ``now``."""
        while self._powered and (self.axis.advance(now) or self._advance_lines(now)):
            self._update_outputs(now)
        self._update_outputs(now)

    def take_output(self) -> bytes:
        """Return the bytes sent since the last call."""
        sent = bytes(self._tx)
        self._tx.clear()
        return sent

    @property
    def next_event(self) -> float:
        """Time at which ``advance`` has something to do, infinite if it waits for bytes."""
        return min(self.axis.next_event, self._dwell_until)

    def alarm(self, number: int, now: float) -> None:
        """Raise an alarm, as a limit switch does."""
        self.axis.kill(now)
        self._reset_state()
        self._locked = True
        self._send(f'ALARM:{number}\r\n')
        if number in (1, 2):
            self._send('[MSG:Reset to continue]\r\n')
            self._needs_reset = True
        self._update_outputs(now)

    # -- realtime bytes

    @property
    def _state(self) -> str:
        if self._locked:
            return 'Alarm'
        if self.axis.state == 'Hold':
            return f'Hold:{int(not self.axis.held)}'
        return self.axis.state

    @property
    def _realtime_commands(self) -> dict[int, Callable[[float], None]]:
        return {
            ord('?'): self._report_status,
            ord('!'): self._hold,
            ord('~'): self._resume,
            0x18: self._reset,
        }

    def _report_status(self, now: float) -> None:
        if self._needs_reset:
            return
        if self.axis.state == 'Home':
            self._report_pending = True  # answered when homing has finished
            return
        position, velocity = self.axis.state_at(now)
        outputs = self._present_outputs()
        self._send(
            self._formatter.status_line(
                state=self._state,
                position=position,
                feed=abs(velocity) * 60,
                rpm=self._modal_state.speed if outputs.spindle else 0.0,
                outputs=self._modal_state.letters(outputs),
                busy=self.axis.state != 'Idle',
                inches=bool(self.settings[_REPORT_INCHES]),
            )
        )

    def _hold(self, now: float) -> None:
        if not self._locked:
            self.axis.hold(now)

    def _resume(self, now: float) -> None:
        self.axis.resume(now)

    def _reset(self, now: float) -> None:
        homing, locked = self.axis.state == 'Home', self._locked and not self._needs_reset
        moved = self.axis.kill(now)
        self._reset_state()
        self._locked = moved or locked
        if moved:
            self._send(f'ALARM:{6 if homing else 3}\r\n')
        self._send_banner(now)

    def _send_banner(self, now: float) -> None:
        self._send(self.banner)
        if self._locked:
            self._send("[MSG:'$H'|'$X' to unlock]\r\n")
        self._update_outputs(now)

    # -- lines

    def _advance_lines(self, now: float) -> bool:
        """Execute one line, or a part of it; return whether there may be more to do."""
        if self.axis.state == 'Hold' or self._needs_reset:
            return False
        if self._wait_condition is not None:
            if not self._wait_condition(now):
                return self.axis.start(now)
            self._wait_condition, self._dwell_until = None, math.inf
            self._send('ok\r\n')
            return True
        text, found, rest = bytes(self._rx).replace(b'\r', b'\n').partition(b'\n')
        if not found:
            return self.axis.start(now)
        self._rx = bytearray(rest)
        self._execute_line(gcode.clean(text.decode('ascii', 'replace')), now)
        return True

    def _execute_line(self, line: str, now: float) -> None:
        try:
            if len(line) > MAX_LINE_LENGTH:
                raise GcodeError(11)
            if line.startswith('$'):
                self._execute_system_command(line[1:], now)
            elif line and self._locked:
                raise GcodeError(9)
            else:
                self._execute_block(gcode.parse_block(line))
        except GcodeError as error:
            self._send(f'error:{error.number}\r\n')
            return
        if self._wait_condition is None:
            self._send('ok\r\n')

    def _execute_block(self, block: GcodeBlock) -> None:
        self._modal_state.apply(block)
        codes = dict(block.codes)
        if codes.get('end') in ('M2', 'M30'):
            codes.update(spindle='M5', coolant='M9')
            self._send('[MSG:Pgm End]\r\n')
        if codes.get('dwell') == 'G4':
            self._wait_condition = self._dwell(block.values['P'])
            return
        if 'spindle' in codes or 'coolant' in codes:
            self._wait_condition = lambda now: self.axis.drained and self._switch_outputs(codes)
        if 'X' in block.values:
            feed = None if self._modal_state.motion == 'G0' else self._modal_state.feed
            relative = self._modal_state.distance == 'G91'
            self.axis.queue_move(block.values['X'], relative, feed)
            if self.axis.planner_full and self._wait_condition is None:
                self._wait_condition = lambda now: not self.axis.planner_full

    def _switch_outputs(self, codes: dict[str, str]) -> bool:
        self._modal_state.switch_outputs(codes)
        self._formatter.include_outputs()
        return True

    def _dwell(self, seconds: float) -> _WaitCondition:
        def is_over(now: float) -> bool:
            if self.axis.drained and self._dwell_until == math.inf:
                self._dwell_until = now + seconds
            return now >= self._dwell_until

        return is_over

    def _execute_system_command(self, command: str, now: float) -> None:
        setting = _SETTING.fullmatch(command)
        if setting:
            self._change_setting(int(setting[1]), float(setting[2]))
        elif command == 'H':
            self._home(now)
        elif command == 'X':
            self._send('[MSG:Caution: Unlocked]\r\n' if self._locked else '')
            self._locked = False
        elif command == '$' and self.axis.state != 'Idle':
            raise GcodeError(8)
        elif command in self._listings:
            self._send(self._listings[command]())
        else:
            raise GcodeError(3 if command[:1].isdecimal() else 2)

    @property
    def _listings(self) -> dict[str, Callable[[], str]]:
        return {
            '': self._formatter.help,
            '$': lambda: self._formatter.settings(self.settings),
            'I': lambda: '[VER:1.1h.20190830:]\r\n[OPT:V,15,128]\r\n',
            'G': self._modal_state.format,
        }

    def _home(self, now: float) -> None:
        if not self.settings[_HOMING_ENABLED]:
            raise GcodeError(5)
        if self.axis.state != 'Idle':
            raise GcodeError(8)
        self._locked = False
        self.axis.home(now)
        self._wait_condition = self._homing_finished

    def _homing_finished(self, now: float) -> bool:
        if self.axis.state == 'Home':
            return False
        if self._report_pending:
            self._report_pending = False
            self._report_status(now)
        return True

    def _change_setting(self, number: int, value: float) -> None:
        if self.axis.state != 'Idle':
            raise GcodeError(8)
        if number not in self.settings:
            raise GcodeError(3)
        if value < 0:
            raise GcodeError(4)
        self.settings[number] = value

    # -- outputs

    def _present_outputs(self) -> LaserOutputs:
        return self._modal_state.outputs(self.settings, self.axis.state == 'Run', self.axis.held)

    def _update_outputs(self, now: float) -> None:
        outputs = self._present_outputs()
        if outputs != self._outputs:
            self._outputs = outputs
            self._on_outputs(now, outputs)

    def _reset_state(self) -> None:
        """Set the state after a reset."""
        self._rx = bytearray()
        self._wait_condition = None
        self._dwell_until = math.inf
        self._needs_reset = self._report_pending = False
        self._modal_state, self._formatter = ModalState(), ReportFormatter()

    def _send(self, text: str) -> None:
        self._tx += text.encode('ascii')
