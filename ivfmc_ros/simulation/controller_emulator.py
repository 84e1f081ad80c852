# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Emulated motion controller behind a pseudo-terminal, with faults on request."""

from collections.abc import Callable
import contextlib
import math
import os
from pathlib import Path
import select
import termios
import threading
import time
from typing import Any

import numpy as np

from ivfmc_ros.devices.motion.trajectory import Trajectory
from ivfmc_ros.errors import FileError
from ivfmc_ros.simulation.emulated_machine import EmulatedMachine
from ivfmc_ros.simulation.fabscan.machine import FabscanMachine
from ivfmc_ros.simulation.grbl.firmware import EMULATED
from ivfmc_ros.simulation.grbl.machine import GrblMachine
from ivfmc_ros.simulation.laser_outputs import LaserOutputs
from ivfmc_ros.simulation.laser_outputs import StickingRelays
from ivfmc_ros.simulation.marlin.machine import MarlinMachine
from ivfmc_ros.simulation.trigger_line import TriggerLine

_POLL_PERIOD = 0.02  # seconds, longest wait for bytes or for the opening of the port
_MIN_WAIT = 0.0005  # seconds, so that a due event causes no busy loop
_LONG_LINE = 4000  # characters, more than any line of a controller
_BOOT_TIME = 0.2  # seconds from opening the port to the banner; a real boot loader takes 1 to 2


FIRMWARES = (*EMULATED, 'marlin', 'fabscan')


class ControllerEmulator:
    """
    Runs an emulated machine in a thread and connects it to a pseudo-terminal.

    path : symbolic link to the pseudo-terminal, made by ``start``
    on_motion, on_outputs, clock_scale : see GrblMachine; times are of time.monotonic
    homing : whether the table has a home switch; GRBL is locked then until it is homed
    firmware : name of the emulated firmware, one of FIRMWARES
    auto_reset : whether opening the port resets the controller, as it does with an Arduino
    seed : of the random bytes that are dropped
    """

    def __init__(
        self,
        path: Path,
        *,
        on_motion: Callable[[float, Trajectory], None] = lambda now, motion: None,
        on_outputs: Callable[[float, LaserOutputs], None] = lambda now, outputs: None,
        clock_scale: float = 1.0,
        homing: bool = False,
        seed: int = 0,
        firmware: str = 'grbl',
        auto_reset: bool = True,
    ) -> None:
        # tests reach into the machine of one firmware or the other
        self._relays = StickingRelays(on_outputs)
        self._on_motion = on_motion
        self._trigger_line: TriggerLine | None = None
        self._on_triggers: Callable[[list[float]], None] = lambda times: None
        self.machine: Any = _machine(firmware, self._move, self._relays.switch, clock_scale)
        self._auto_reset = auto_reset
        self._powered = not auto_reset
        self.machine.settings[22] = float(homing)
        self._path = path
        self._rng = np.random.default_rng(seed)
        self._drop = self._join = 0.0
        self._silent_until = -math.inf
        self._boot_at = math.inf
        self._closing = threading.Event()
        self._lock = threading.Lock()
        self._master = -1
        self._thread: threading.Thread | None = None

    def connect_trigger(
        self, line: TriggerLine, on_triggers: Callable[[list[float]], None]
    ) -> None:
        """
        Let the axis give pulses on a trigger line; to be called before ``start``.

        line : its step in controller units
        on_triggers : called with the times of pulses, ascending
        """
        self._trigger_line, self._on_triggers = line, on_triggers

    def start(self) -> None:
        """
        Make the port and start the thread.

        :raises FileError: the path exists already, or its folder does not
        """
        self._plug()
        if not self._auto_reset:
            self.machine.power_on(time.monotonic())
        self._thread = threading.Thread(target=self._serve, name='emulator', daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End the thread and remove the port."""
        self._closing.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None
            self._path.unlink(missing_ok=True)
            if self._master >= 0:
                os.close(self._master)
                self._master = -1

    def fault(self, text: str) -> None:
        """
        Cause a fault of the controller.

        ``drop P`` loses each byte to the computer with probability P; ``join P`` loses each
        byte of line ends so; ``silence S`` sends nothing for S seconds; ``reset`` restarts the
        controller, as after a brown-out;
        ``alarm N`` raises an alarm; ``door`` opens the safety door of GRBL; ``slip D`` turns the
        table by D degrees on the shaft;
        ``trigger drop P`` loses each pulse of the trigger line with probability P, ``trigger
        double P`` doubles it, ``trigger noise R`` adds R false ones a second while the axis moves;
        ``stick`` welds the relays of the lasers that are on, which shine until ``release``;
        ``noise`` sends a line of random bytes, ``say TEXT`` a line, ``half`` the begin of one,
        ``long`` a line of 4000 characters; ``unplug`` removes the port and with it the supply of
        the controller, as with a USB cable: outputs off, position lost; ``plug`` ends that.

        :raises ValueError: the text is no such fault
        """
        name, _, argument = text.strip().partition(' ')
        cause = self._faults.get(name)
        if cause is None:
            raise ValueError(f'there is no fault {name!r}; see ControllerEmulator.fault')
        with self._lock:
            cause(argument, time.monotonic())

    @property
    def _faults(self) -> dict[str, Callable[[str, float], None]]:
        return {
            'drop': lambda text, now: setattr(self, '_drop', float(text)),
            'join': lambda text, now: setattr(self, '_join', float(text)),
            'silence': lambda text, now: setattr(self, '_silent_until', now + float(text)),
            'reset': lambda text, now: self.machine.power_on(now),
            'door': lambda text, now: self.machine.open_door(now),
            'alarm': lambda text, now: self.machine.alarm(int(text), now),
            'slip': lambda text, now: self.machine.axis.slip(float(text), now),
            'trigger': lambda text, now: self._spoil_trigger(text),
            'stick': lambda text, now: self._relays.stick(),
            'release': lambda text, now: self._relays.release(now),
            'noise': lambda text, now: self._write(self._noise() + b'\n'),
            'say': lambda text, now: self._write(f'{text}\r\n'.encode()),
            'half': lambda text, now: self._write(b'<Idle|MPos:1'),
            'long': lambda text, now: self._write(b'x' * _LONG_LINE + b'\r\n'),
            'unplug': lambda text, now: self._unplug(now),
            'plug': lambda text, now: self._replug(now),
        }

    def _spoil_trigger(self, text: str) -> None:
        name, _, value = text.partition(' ')
        if self._trigger_line is None or name not in ('drop', 'double', 'noise'):
            raise ValueError(f'trigger {text}: no such fault, or no trigger line')
        setattr(self._trigger_line, name, float(value))

    def _move(self, now: float, motion: Trajectory) -> None:
        if self._trigger_line is not None:
            self._give_triggers(self._trigger_line.move(now, motion))
        self._on_motion(now, motion)

    def _give_triggers(self, times: list[float]) -> None:
        if times:
            self._on_triggers(times)

    def _noise(self) -> bytes:
        return self._rng.integers(1, 255, 20).astype(np.uint8).tobytes()

    def _replug(self, now: float) -> None:
        self._unplug(now)
        self._plug()

    def _serve(self) -> None:
        opened = False
        while not self._closing.is_set():
            state = self._wait_for_bytes()
            with self._lock:
                if state & select.POLLHUP or self._master < 0:
                    opened = False
                elif not opened:
                    opened = True
                    if self._auto_reset or not self._powered:
                        self._boot_at, self._powered = time.monotonic() + _BOOT_TIME, True
                self._process(bool(state & select.POLLIN))
            if not opened:
                self._closing.wait(_POLL_PERIOD)

    def _wait_for_bytes(self) -> int:
        """Return the state of the port (see ``poll``) when it changes or the next event is due."""
        poller = select.poll()
        with self._lock:
            # a port that was plugged in again is another one
            if self._master >= 0:
                poller.register(self._master, select.POLLIN)
        events = poller.poll(self._wait_time() * 1000)
        return events[0][1] if events else 0

    def _wait_time(self) -> float:
        due = min(self.machine.next_event, self._boot_at)
        return float(np.clip(due - time.monotonic(), _MIN_WAIT, _POLL_PERIOD))

    def _process(self, readable: bool) -> None:
        data = b''
        if readable:
            with contextlib.suppress(OSError):  # the port was closed meanwhile
                data = os.read(self._master, 4096)
        now = time.monotonic()
        if now >= self._boot_at:
            self._boot_at = math.inf
            self.machine.power_on(now)
        elif self._boot_at < math.inf:
            data = b''  # the boot loader discards it
        self.machine.advance(now)
        self.machine.feed(data, now)
        if self._trigger_line is not None:
            self._give_triggers(self._trigger_line.advance(now))
        output = self.machine.take_output()
        if output and now >= self._silent_until:
            self._write(output)

    def _write(self, output: bytes) -> None:
        if self._drop or self._join:
            data = np.frombuffer(output, dtype=np.uint8)
            line_end = np.isin(data, tuple(b'\r\n'))
            probability = np.where(line_end, max(self._drop, self._join), self._drop)
            output = data[self._rng.random(len(data)) >= probability].tobytes()
        # the port is closed, or its buffer is full
        with contextlib.suppress(OSError):
            os.write(self._master, output)

    def _plug(self) -> None:
        self._master, slave = os.openpty()
        _make_raw(slave)
        name = os.ttyname(slave)
        # a pseudo-terminal reports a closed port (POLLHUP) only after it was opened once
        os.close(slave)
        os.set_blocking(self._master, False)
        try:
            self._path.symlink_to(name)
        except OSError as error:
            os.close(self._master)
            self._master = -1
            raise FileError(f'{self._path}: cannot be made: {error.strerror}') from error

    def _unplug(self, now: float) -> None:
        master, self._master = self._master, -1
        if master < 0:
            return
        os.close(master)
        self._path.unlink(missing_ok=True)
        self._boot_at, self._powered = math.inf, False
        self.machine.power_off(now)


def _machine(
    firmware: str,
    on_motion: Callable[[float, Trajectory], None],
    on_outputs: Callable[[float, LaserOutputs], None],
    clock_scale: float,
) -> EmulatedMachine:
    if firmware in EMULATED:
        return GrblMachine(
            on_motion=on_motion,
            on_outputs=on_outputs,
            clock_scale=clock_scale,
            firmware=EMULATED[firmware],
        )
    machine = MarlinMachine if firmware == 'marlin' else FabscanMachine
    return machine(on_motion=on_motion, on_outputs=on_outputs, clock_scale=clock_scale)


def _make_raw(terminal: int) -> None:
    modes = termios.tcgetattr(terminal)
    modes[0] = modes[1] = modes[3] = 0
    termios.tcsetattr(terminal, termios.TCSANOW, modes)
