# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Emulation of a controller of the GRBL family: bytes in, bytes out, one axis, two outputs.

Responses were compared with GRBL 1.1h of 2019-08-30, built from its sources for a computer.
"""

from collections.abc import Callable
import math
import re

from ivfmc_ros.devices.motion.trajectory import Trajectory
from ivfmc_ros.simulation.emulated_axis import EmulatedAxis
from ivfmc_ros.simulation.grbl import gcode
from ivfmc_ros.simulation.grbl.firmware import EMULATED
from ivfmc_ros.simulation.grbl.firmware import EmulatedFirmware
from ivfmc_ros.simulation.grbl.gcode import GcodeBlock
from ivfmc_ros.simulation.grbl.gcode import GcodeError
from ivfmc_ros.simulation.grbl.modal_state import ModalState
from ivfmc_ros.simulation.grbl.report import ReportFormatter
from ivfmc_ros.simulation.laser_outputs import LaserOutputs

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
_REPORT_INCHES, _HOMING_ENABLED, _MAX_SPINDLE = 13, 22, 30
_SETTING = re.compile(r'(\d+|/[\w/]+)=(-?\d+\.?\d*)')
_HORUS_LASER_S = 255.0  # seconds after which Horus turns a laser off by itself
_MESSAGE_PERIOD = 3  # responses from one message at any time to the next

# Returns at a time (seconds) whether the controller need not wait any longer.
_WaitCondition = Callable[[float], bool]


class GrblMachine:
    """
    The controller. Times are steady seconds, positions are controller units (degrees).

    on_motion : called with the time and the trajectory of the table, see EmulatedAxis
    on_outputs : called with the time and the outputs when these change
    clock_scale : controller seconds per second; a ceramic resonator is good to 0.5 %
    firmware : that is emulated
    banner : sent at each start
    index_mark : input that a switch on the table makes active, and from where to where, degrees of
        a turn; None without a switch
    """

    def __init__(
        self,
        *,
        on_motion: Callable[[float, Trajectory], None],
        on_outputs: Callable[[float, LaserOutputs], None],
        clock_scale: float = 1.0,
        firmware: EmulatedFirmware = EMULATED['grbl'],
    ) -> None:
        self.settings = _settings(firmware)
        self.firmware = firmware
        self.banner = firmware.banner
        self.index_mark: tuple[str, float, float] | None = None
        self.axis = EmulatedAxis(self.settings, on_motion, clock_scale, index=firmware.index)
        self.door_open = False
        self._responses = 0
        self._dark_at = math.inf
        self._on_outputs = on_outputs
        self._outputs = LaserOutputs()
        self._tx = bytearray()
        self._powered = False
        self._locked = self._needs_reset = self._report_pending = False
        self._rx = bytearray()
        self._wait_condition: _WaitCondition | None = None
        self._dwell_until = math.inf
        self._modal_state, self._formatter = ModalState(), ReportFormatter(firmware)

    # -- power and the serial line

    def power_on(self, now: float) -> None:
        """Start, or restart; the present position becomes 0."""
        self.axis.kill(now)
        self.axis.reset_origin()
        self._reset_state()
        self._powered = True
        self._locked = bool(self.settings[_HOMING_ENABLED])
        self._send(self.firmware.boot)
        self._send_banner(now)

    def power_off(self, now: float) -> None:
        """Lose the supply: all outputs go off, and the axis stops at once."""
        self.axis.kill(now)
        self._reset_state()
        self._powered = self._locked = False
        self._tx.clear()
        self._update_outputs(now)

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
        if now >= self._dark_at:
            self._dark_at = math.inf
            self._modal_state.switch_outputs({'spindle': 'M5', 'coolant': 'M9'})
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
        return min(self.axis.next_event, self._dwell_until, self._dark_at)

    def alarm(self, number: int, now: float) -> None:
        """Raise an alarm, as a limit switch does."""
        self.axis.kill(now)
        self._reset_state()
        self._locked = True
        self._send(self.firmware.alarm(number))
        if number in (1, 2):
            self._send(self.firmware.message('Reset to continue'))
            self._needs_reset = True
        self._update_outputs(now)

    # -- realtime bytes

    @property
    def _state(self) -> str:
        if self._locked:
            return 'Alarm'
        if self.door_open:
            return 'Door:0'
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

    def open_door(self, now: float) -> None:
        """Open the safety door: the axis brakes, outputs go off, until a reset."""
        self.door_open = True
        self.axis.hold(now)
        self._modal_state.switch_outputs({'spindle': 'M5', 'coolant': 'M9'})

    def _report_status(self, now: float) -> None:
        if self._needs_reset:
            return
        if self.axis.state == 'Home':
            self._report_pending = True  # answered when homing has finished
            return
        position, velocity = self.axis.state_at(now)
        outputs = self.present_outputs()
        self._send(
            self._formatter.status_line(
                state=self._state,
                position=position,
                feed=abs(velocity) * 60,
                rpm=self._modal_state.speed if outputs.spindle else 0.0,
                outputs=self._modal_state.letters(outputs),
                busy=self.axis.state != 'Idle',
                inches=bool(self.settings[_REPORT_INCHES]),
                pins=self._active_pins(now),
            )
        )

    def _active_pins(self, now: float) -> str:
        if self.index_mark is None:
            return ''
        pin, begin, end = self.index_mark
        return pin if begin <= self.axis.table_at(now) % 360.0 < end else ''

    def _hold(self, now: float) -> None:
        if not self._locked:
            self.axis.hold(now)

    def _resume(self, now: float) -> None:
        self.axis.resume(now)

    def _reset(self, now: float) -> None:
        homing, locked = self.axis.state == 'Home', self._locked and not self._needs_reset
        held = self.firmware.old and self.axis.state == 'Hold'
        moved = self.axis.kill(now) or held
        self._reset_state()
        self._locked = moved or locked
        if moved:
            self._send(self.firmware.alarm(6 if homing else 3))
        self._send_banner(now)

    def _send_banner(self, now: float) -> None:
        self._send(self.banner)
        if self._locked:
            self._send(self.firmware.message("'$H'|'$X' to unlock"))
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
            self._respond()
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
                firmware = self.firmware
                self._execute_block(gcode.parse_block(line, firmware.axes, firmware.groups), now)
        except GcodeError as error:
            self._send(self.firmware.error(error.number))
            return
        if self._wait_condition is None:
            self._respond()

    def _respond(self) -> None:
        """Send ok; some firmwares send messages at any time, so also right before it."""
        messages = self.firmware.messages
        self._responses += 1
        if messages and self._responses % _MESSAGE_PERIOD == 0:
            number = self._responses // _MESSAGE_PERIOD % len(messages)
            self._send(f'{messages[number]}\r\n')
        self._send('ok\r\n')

    def _execute_block(self, block: GcodeBlock, now: float) -> None:
        self._modal_state.apply(block)
        codes = dict(block.codes)
        if codes.get('end') in ('M2', 'M30'):
            codes.update(spindle='M5', coolant='M9')
            self._send('[MSG:Pgm End]\r\n')
        if codes.get('dwell') == 'G4':
            self._wait_condition = self._dwell(block.values['P'])
            return
        if 'laser' in codes:
            self._modal_state.speed = self.settings[_MAX_SPINDLE]
            codes = _laser_codes(codes['laser'], block.values.get('T', 0.0))
            self._dark_at = now + _HORUS_LASER_S
        if 'spindle' in codes or 'coolant' in codes:
            self._wait_condition = lambda now: self.axis.drained and self._switch_outputs(codes)
        if self.firmware.axis in block.values:
            feed = None if self._modal_state.motion == 'G0' else self._modal_state.feed
            if feed is not None and 'motor' in self.firmware.groups:
                feed *= 60.0  # Horus: degrees per second
            relative = self._modal_state.distance == 'G91'
            self.axis.queue_move(block.values[self.firmware.axis], relative, feed)
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
            self._change_setting(setting[1], float(setting[2]))
        elif command == 'H':
            self._home(now)
        elif command == 'X':
            self._send(self.firmware.message('Caution: Unlocked') if self._locked else '')
            self._locked = False
        elif command == '$' and self.axis.state != 'Idle':
            raise GcodeError(8)
        elif command in self._listings:
            self._send(self._listings[command]())
        elif listed := self._formatter.setting(command.lower(), self.settings):
            self._send(listed)
        else:
            raise GcodeError(3 if command[:1].isdecimal() else 2)

    @property
    def _listings(self) -> dict[str, Callable[[], str]]:
        return {
            '': self._formatter.help,
            '$': lambda: self._formatter.settings(self.settings),
            'I': lambda: self.firmware.identity,
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

    def _change_setting(self, key: str, value: float) -> None:
        number = int(key) if key.isdecimal() else self._formatter.path_number(key.lower())
        if self.axis.state != 'Idle':
            raise GcodeError(8)
        if number is None or number not in self.settings:
            raise GcodeError(3)
        if value < 0:
            raise GcodeError(4)
        self.settings[number] = value

    # -- outputs

    def present_outputs(self) -> LaserOutputs:
        """Return the outputs."""
        return self._modal_state.outputs(self.settings, self.axis.state == 'Run', self.axis.held)

    def _update_outputs(self, now: float) -> None:
        outputs = self.present_outputs()
        if outputs != self._outputs:
            self._outputs = outputs
            self._on_outputs(now, outputs)

    def _reset_state(self) -> None:
        """Set the state after a reset."""
        self._rx = bytearray()
        self._wait_condition = None
        self._dwell_until = math.inf
        self._needs_reset = self._report_pending = self.door_open = False
        self._modal_state = ModalState()
        self._formatter = ReportFormatter(self.firmware)
        self._dark_at = math.inf

    def _send(self, text: str) -> None:
        self._tx += text.encode('ascii')


def _settings(firmware: EmulatedFirmware) -> dict[int, float]:
    """Return the settings with those of the table at the axis that turns it."""
    settings = dict(SETTINGS)
    for first in (100, 110, 120, 130):
        settings[first + firmware.index] = SETTINGS[first]
    return settings


def _laser_codes(code: str, number: float) -> dict[str, str]:
    """Return the codes of GRBL for a laser of Horus: 1 on the first output, 2 on the second."""
    is_on = code == 'M71'
    if number == 1:
        return {'spindle': 'M3' if is_on else 'M5'}
    return {'coolant': 'M8' if is_on else 'M9'} if number == 2 else {}
