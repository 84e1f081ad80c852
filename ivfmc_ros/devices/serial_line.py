# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Serial port that is read line by line in a thread of its own."""

from collections.abc import Callable
import contextlib
import errno
import select
import termios
import threading
import time

import serial

from ivfmc_ros.devices.controller import NOT_CONNECTED
from ivfmc_ros.errors import ControllerLostError

_READ_TIMEOUT = 0.02  # seconds; on_tick is called at least this often
_WRITE_TIMEOUT = 1.0  # seconds; commands are short: only a port without a reader blocks so long
_MAX_LINE_LENGTH = 512  # bytes; GRBL's lines are below 130, longer input without an end is noise


class SerialLine:
    """
    Sends bytes to a motion controller and receives lines from it.

    on_line : called in the thread with each line and the monotonic second of its first byte
    on_tick : called in the thread at least every 20 ms
    on_lost : called in the thread, once, with the reason when the port fails
    unfinished : bytes that were received after the last line
    """

    def __init__(
        self,
        *,
        on_line: Callable[[str, float], None],
        on_tick: Callable[[], None],
        on_lost: Callable[[str], None],
    ) -> None:
        self._on_line, self._on_tick, self._on_lost = on_line, on_tick, on_lost
        self._port: serial.Serial | None = None
        self._write_lock = threading.Lock()
        self._thread: threading.Thread | None = None
        self._closing = threading.Event()
        self._name = ''
        self._adopted: tuple[serial.Serial, bytes] | None = None
        self._is_adopted = False
        self.unfinished = b''

    def open(self, name: str, baud: int) -> None:
        """
        Open the port and start the reading thread.

        name : device file or pyserial URL
        :raises ControllerLostError: there is no such port, or another process uses it
        """
        adopted, self._adopted = self._adopted, None
        self._is_adopted = adopted is not None
        port, received = adopted or (open_port(name, baud), b'')
        self._name, self._port, self.unfinished = name, port, received
        self._closing.clear()
        self._thread = threading.Thread(target=self._run, name='controller', daemon=True)
        self._thread.start()

    def adopt(self, port: serial.Serial, received: bytes) -> None:
        """Use an open port, from which bytes were received, for the next ``open``."""
        self._adopted = port, received

    @property
    def adopted(self) -> bool:
        """Whether the port was open before: the controller has started, and was asked."""
        return self._is_adopted

    @property
    def handle(self) -> int | None:
        """File descriptor of the port; None while it is closed, and for ports without one."""
        port = self._port
        if port is None:
            return None
        try:
            return int(port.fileno())
        except (AttributeError, OSError):
            return None

    def close(self) -> None:
        """End the thread and close the port; may be called from the thread."""
        self._closing.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join()
            self._thread = None
        if self._port is not None:
            with contextlib.suppress(OSError):
                self._port.close()
            self._port = None

    def write(self, data: bytes) -> None:
        """
        Send bytes.

        :raises ControllerLostError: the port is closed, or does not accept data
        """
        port = self._port
        if port is None:
            raise ControllerLostError(NOT_CONNECTED)
        try:
            with self._write_lock:
                port.write(data)
        # pyserial lets a TypeError out when the port is closed by another thread
        except (OSError, TypeError, termios.error) as error:
            raise ControllerLostError(f'port {self._name}: cannot be written: {error}') from error

    def _run(self) -> None:
        # any error, also of a callback, ends the thread: without it the controller is lost
        try:
            self._read_lines(self._port)
        except Exception as error:
            self._on_lost(f'port {self._name}: {error}')
            # a device file that stays open gives the device another name when it is plugged in
            if self._port is not None:
                with contextlib.suppress(OSError):
                    self._port.close()

    def _read_lines(self, port: serial.Serial | None) -> None:
        partial, started = self.unfinished, time.monotonic()
        poller, handle = select.poll(), self.handle
        if handle is not None:
            poller.register(handle, select.POLLIN)
        while port is not None and not self._closing.is_set():
            # cheaper than the wait of pyserial, which most of the calls would end without bytes
            is_readable = handle is None or poller.poll(_READ_TIMEOUT * 1000)
            data = port.read(max(1, port.in_waiting)) if is_readable else b''
            now = time.monotonic()
            started = started if partial else now
            *lines, partial = (partial + data).split(b'\n')
            for line in lines:
                self._on_line(line.strip().decode('ascii', 'replace'), started)
                started = now
            partial = self.unfinished = partial[-_MAX_LINE_LENGTH:]
            self._on_tick()


def open_port(name: str, baud: int) -> serial.Serial:
    """
    Open a port for this process alone.

    name : device file or pyserial URL
    :raises ControllerLostError: there is no such port, or another process uses it
    """
    try:
        return serial.serial_for_url(
            name, baud, timeout=_READ_TIMEOUT, write_timeout=_WRITE_TIMEOUT, exclusive=True
        )
    # termios.error is no OSError: the port vanished while it was opened
    except (OSError, ValueError, termios.error) as error:
        denied = getattr(error, 'errno', None) == errno.EACCES
        hint = '; add the user to the group that owns the port (dialout)' if denied else ''
        raise ControllerLostError(f'port {name}: cannot be opened: {error}{hint}') from error
