# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Starts the guard process of the beam and gives it the beats of the driver."""

from collections.abc import Callable
import contextlib
import os
from pathlib import Path
import subprocess
import sys
import threading
import time

from ivfmc_ros.devices.controller import OffLine
from ivfmc_ros.devices.guard import process

# Seconds without a beat until the guard acts. The off bytes take another 0.1 s, and the beam has
# to be off half a second after the driver hangs.
TIMEOUT_S = 0.35
_BEAT_S = 0.05  # seconds between beats
# ... while the cell is dark and stands, where the guard would not act; ``announce`` comes first
_DARK_BEAT_S = 0.2
# Seconds after an announcement within which the laser or the motion has begun.
_ANNOUNCED_S = 0.5
_ACTION = (
    f'the guard process turned the lasers off and stopped the table, because this driver did not '
    f'run for {TIMEOUT_S} s; is the computer overloaded?'
)
_END_S = 1.0  # seconds that the guard may take to end


class BeamGuard:
    """
    The guard process of one driver.

    is_alive, is_lit : return whether the driver's watchdog runs, and whether a laser may be on or
        the table moves; called 5 to 20 times a second in a thread of its own
    fault : why there is no guard though the controller is connected, '' otherwise
    action : what it did to a driver that it took for hung, since ``start`` or ``forgive``; or ''
    """

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._pipe = -1
        self._ending = threading.Event()
        # ends the wait for the next beat
        self._hurry = threading.Event()
        # steady second until which what was announced may begin
        self._announced_until = 0.0
        self._thread: threading.Thread | None = None
        self.fault = ''
        self.action = ''

    def start(
        self, line: OffLine | None, is_alive: Callable[[], bool], is_lit: Callable[[], bool]
    ) -> None:
        """
        Start the process for a connection; that of an earlier connection ends.

        line : of the controller; None where its port cannot be shared, which is a fault
        """
        self.end()
        if line is None:
            self.fault = 'no guard of the beam: the port has no file descriptor to share'
            return
        steps = [f'{data.hex()}:{seconds}' for data, seconds in line.steps]
        reading, self._pipe = os.pipe()
        os.set_blocking(self._pipe, False)
        command = [sys.executable, '-I', '-S', str(Path(process.__file__)), str(line.handle)]
        try:
            self._process = subprocess.Popen(
                [*command, str(reading), str(TIMEOUT_S), *steps],
                pass_fds=(line.handle, reading),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                # a signal to the group of the driver must not end the guard
                start_new_session=True,
            )
        except OSError as error:
            self.fault = f'no guard of the beam: {error}'
            return
        finally:
            os.close(reading)
        if self._process.stdout is not None:
            os.set_blocking(self._process.stdout.fileno(), False)
        self.fault, self.action = '', ''
        self._ending.clear()
        self._announced_until = 0.0
        self._thread = threading.Thread(
            target=self._beat, args=(is_alive, is_lit), name='beats', daemon=True
        )
        self._thread.start()

    @property
    def running(self) -> bool:
        """Whether the process runs."""
        return self._process is not None and self._process.poll() is None

    @property
    def pid(self) -> int | None:
        """Id of the process, None without one."""
        return None if self._process is None else self._process.pid

    def announce(self) -> None:
        """Tell the guard that a laser or a motion is about to begin."""
        # a beat that was on its way must not say dark after this
        self._announced_until = time.monotonic() + _ANNOUNCED_S
        self._write(process.LIT)
        self._hurry.set()

    def forgive(self) -> None:
        """Forget the last action."""
        self.action = ''

    def end(self) -> None:
        """End the process; the lasers stay as they are. May be called again."""
        self._ending.set()
        self._hurry.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join()
        self._thread = None
        if self._pipe >= 0:
            with contextlib.suppress(OSError):
                os.write(self._pipe, process.END)
            os.close(self._pipe)
            self._pipe = -1
        if self._process is not None:
            try:
                self._process.wait(_END_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
            if self._process.stdout is not None:
                self._process.stdout.close()
            self._process = None

    def _beat(self, is_alive: Callable[[], bool], is_lit: Callable[[], bool]) -> None:
        period = _BEAT_S
        while not self._ending.is_set():
            self._hurry.wait(period)
            self._hurry.clear()
            self._read()
            if not is_alive():
                continue
            lit = is_lit() or time.monotonic() < self._announced_until
            self._write(process.LIT if lit else process.DARK)
            period = _BEAT_S if lit else _DARK_BEAT_S
            if self.fault:
                return

    def _read(self) -> None:
        output = None if self._process is None else self._process.stdout
        if output is not None and process.ACTED in (output.read() or b''):
            self.action = _ACTION

    def _write(self, beat: bytes) -> None:
        try:
            os.write(self._pipe, beat)
        except BlockingIOError:
            pass  # the guard does not read: it is stopped, and has all beats that it needs
        except OSError:
            self.fault = 'the guard process of the beam has ended'
