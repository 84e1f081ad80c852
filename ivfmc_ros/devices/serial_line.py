# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A serial port whose lines are read by a thread of its own."""

from collections.abc import Callable
import contextlib
import errno
import threading
import time

import serial

from ivfmc_ros.errors import BoardLostError

_READ_WAIT = 0.02  # seconds; the thread looks at other things as often as this
_WRITE_WAIT = 1.0  # seconds; nothing that is sent here fills a buffer, unless nobody reads it
_LONGEST = 512  # bytes; more without an end of line is noise


class SerialLine:
    """
    Lines to and from a board.

    on_line : called in the thread with a line and the monotonic second at which it began
    on_tick : called in the thread every 20 ms or sooner
    on_lost : called in the thread, once, when the port fails
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
        self._writing = threading.Lock()
        self._thread: threading.Thread | None = None
        self._closing = threading.Event()
        self._name = ''

    def open(self, name: str, baud: int) -> None:
        """
        Open the port and begin to read.

        :raises BoardLostError: there is no such port, or somebody else uses it
        """
        try:
            port = serial.serial_for_url(
                name, baud, timeout=_READ_WAIT, write_timeout=_WRITE_WAIT, exclusive=True
            )
        except (OSError, ValueError) as error:
            denied = getattr(error, 'errno', None) == errno.EACCES
            hint = '; is the user in the group that owns it (dialout)?' if denied else ''
            raise BoardLostError(f'port {name}: cannot be opened: {error}{hint}') from error
        self._name, self._port = name, port
        self._closing.clear()
        self._thread = threading.Thread(target=self._read, name='board', daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread and close the port."""
        self._closing.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join()
            self._thread = None
        if self._port is not None:
            with contextlib.suppress(OSError):
                self._port.close()
            self._port = None

    def write(self, data: bytes) -> None:
        """:raises BoardLostError: the port takes nothing."""
        port = self._port
        if port is None:
            raise BoardLostError('the board is not connected; clear the alarm to connect again')
        try:
            with self._writing:
                port.write(data)
        # pyserial lets a TypeError out when the port is closed under it
        except (OSError, TypeError) as error:
            raise BoardLostError(f'port {self._name}: cannot be written: {error}') from error

    def _read(self) -> None:
        # pyserial lets other errors out, too; and a board that nobody hears any more is lost
        try:
            self._listen(self._port)
        except Exception as error:
            self._on_lost(f'port {self._name}: {error}')

    def _listen(self, port: serial.Serial | None) -> None:
        rest, began = b'', 0.0
        while port is not None and not self._closing.is_set():
            data = port.read(max(1, port.in_waiting))
            now = time.monotonic()
            began = began if rest else now
            *lines, rest = (rest + data).split(b'\n')
            for line in lines:
                self._on_line(line.strip().decode('ascii', 'replace'), began)
                began = now
            rest = rest[-_LONGEST:]
            self._on_tick()
