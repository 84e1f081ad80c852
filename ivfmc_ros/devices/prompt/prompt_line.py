# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Requests to a controller that ends each answer with a prompt, one at a time."""

from collections.abc import Callable
import threading
import time

from ivfmc_ros.devices.serial_line import SerialLine
from ivfmc_ros.errors import ControllerLostError
from ivfmc_ros.errors import DeviceError

_POLL_PERIOD = 0.02  # seconds between looks at the clock while an answer is awaited
# Seconds before a line is sent again, in which a late answer is discarded.
_QUIET_TIME = 0.2


class PromptLine:
    """
    Sends lines and collects their answers. Thread safe.

    serial : the port
    is_end : whether a line ends an answer
    is_busy : whether a line says that the controller is still at work
    on_other : called in the reading thread with each line that comes without a request
    on_lost : called, once, with the reason when the port fails
    """

    def __init__(
        self,
        *,
        is_end: Callable[[str], bool],
        is_busy: Callable[[str], bool],
        on_other: Callable[[str], None],
        on_lost: Callable[[str], None],
    ) -> None:
        self._is_end, self._is_busy, self._on_other = is_end, is_busy, on_other
        self._on_lost = on_lost
        self.serial = SerialLine(
            on_line=self._handle_line, on_tick=lambda: None, on_lost=self._handle_lost
        )
        self._request_lock = threading.Lock()
        self._changed = threading.Condition()
        self._answer: list[str] | None = None
        self._ended = False
        self._heard_at = 0.0
        self._failure: DeviceError | None = None

    def open(self, name: str, baud: int) -> None:
        """
        Open the port.

        :raises ControllerLostError: it cannot be opened
        """
        self._failure = None
        self.serial.open(name, baud)

    def close(self) -> None:
        """Close the port; a request that waits fails."""
        self.abort(ControllerLostError('the connection to the controller was closed'))
        self.serial.close()

    def request(self, text: str, *, seconds: float = 1.0, attempts: int = 2) -> list[str]:
        """
        Send a line and return the lines of its answer without the prompt.

        seconds : without an answer, and without a line that says busy
        attempts : how often the line is sent; 1 for what must not be done twice
        :raises ControllerLostError: there is no answer
        :raises DeviceError: the reason of an abort
        """
        with self._request_lock:
            for attempt in range(attempts):
                if attempt:
                    time.sleep(_QUIET_TIME)
                answer = self._ask(text, seconds)
                if answer is not None:
                    return answer
        raise ControllerLostError(
            f'{text}: no answer from the controller within {seconds:g} s'
            + (', though the line was sent twice' if attempts > 1 else '')
        )

    def abort(self, reason: DeviceError) -> None:
        """End the request that waits; its caller gets ``reason``."""
        with self._changed:
            self._failure = reason if self._answer is not None else None
            self._changed.notify_all()

    def _ask(self, text: str, seconds: float) -> list[str] | None:
        with self._changed:
            self._answer, self._ended, self._failure = [], False, None
            self._heard_at = time.monotonic()
        try:
            self.serial.write(f'{text}\n'.encode('ascii'))
            return self._await_end(seconds)
        finally:
            with self._changed:
                self._answer = None

    def _await_end(self, seconds: float) -> list[str] | None:
        with self._changed:
            while not self._ended:
                if self._failure is not None:
                    raise self._failure
                if time.monotonic() - self._heard_at > seconds:
                    return None
                self._changed.wait(_POLL_PERIOD)
            return self._answer

    def _handle_line(self, text: str, received_at: float) -> None:
        with self._changed:
            if self._answer is not None and not self._ended:
                if self._is_end(text):
                    self._ended = True
                elif self._is_busy(text):
                    self._heard_at = time.monotonic()
                else:
                    self._answer.append(text)
                self._changed.notify_all()
        self._on_other(text)

    def _handle_lost(self, reason: str) -> None:
        self.abort(ControllerLostError(reason))
        self._on_lost(reason)
