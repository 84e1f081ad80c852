# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Emulated GRBL 1.1 controller behind a pseudo-terminal, with faults on request."""

from collections.abc import Callable
import contextlib
import math
import os
from pathlib import Path
import select
import termios
import threading
import time

import numpy as np

from ivfmc_ros.devices.motion.trajectory import Trajectory
from ivfmc_ros.errors import FileError
from ivfmc_ros.simulation.grbl.machine import GrblMachine
from ivfmc_ros.simulation.grbl.modal_state import LaserOutputs

_POLL_PERIOD = 0.02  # seconds, longest wait for bytes or for the opening of the port
_MIN_WAIT = 0.0005  # seconds, so that a due event causes no busy loop
_BOOT_TIME = 0.2  # seconds from opening the port to the banner; a real boot loader takes 1 to 2


class ControllerEmulator:
    """
    Runs a GrblMachine in a thread and connects it to a pseudo-terminal.

    Opening the port resets the controller, as it does with an Arduino.

    path : symbolic link to the pseudo-terminal, made by ``start``
    on_motion, on_outputs, clock_scale : see GrblMachine; times are of time.monotonic
    homing : whether the table has a home switch; it is locked then until it is homed
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
    ) -> None:
        self.machine = GrblMachine(
            on_motion=on_motion, on_outputs=on_outputs, clock_scale=clock_scale
        )
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

    def start(self) -> None:
        """
        Make the port and start the thread.

        :raises FileError: the path exists already, or its folder does not
        """
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
            raise FileError(f'{self._path}: cannot be made: {error.strerror}') from error
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
        ``alarm N`` raises an alarm; ``slip D`` turns the table by D degrees on the shaft;
        ``noise`` sends a line of random bytes; ``unplug`` removes the port.

        :raises ValueError: the text is no such fault
        """
        name, _, argument = text.strip().partition(' ')
        now = time.monotonic()
        with self._lock:
            if name == 'drop':
                self._drop = float(argument)
            elif name == 'join':
                self._join = float(argument)
            elif name == 'silence':
                self._silent_until = now + float(argument)
            elif name == 'reset':
                self.machine.power_on(now)
            elif name == 'alarm':
                self.machine.alarm(int(argument), now)
            elif name == 'slip':
                self.machine.axis.slip(float(argument), now)
            elif name == 'noise':
                self._write(self._rng.integers(1, 255, 20).astype(np.uint8).tobytes() + b'\n')
            elif name == 'unplug':
                self._unplug()
            else:
                raise ValueError(f'there is no fault {name!r}; see ControllerEmulator.fault')

    def _serve(self) -> None:
        poller = select.poll()
        poller.register(self._master, select.POLLIN)
        opened = False
        while not self._closing.is_set() and self._master >= 0:
            events = poller.poll(self._wait_time() * 1000)
            state = events[0][1] if events else 0
            with self._lock:
                if state & select.POLLHUP:
                    opened = False
                elif not opened:
                    opened, self._boot_at = True, time.monotonic() + _BOOT_TIME
                self._process(bool(state & select.POLLIN))
            if not opened:
                self._closing.wait(_POLL_PERIOD)

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

    def _unplug(self) -> None:
        master, self._master = self._master, -1
        os.close(master)
        self._path.unlink(missing_ok=True)


def _make_raw(terminal: int) -> None:
    modes = termios.tcgetattr(terminal)
    modes[0] = modes[1] = modes[3] = 0
    termios.tcsetattr(terminal, termios.TCSANOW, modes)
