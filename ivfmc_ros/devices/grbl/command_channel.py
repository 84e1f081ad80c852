# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Command channel to a GRBL controller with one line in flight.

Each line is sent after the response to the one before has arrived ("send-response" streaming of
GRBL's interface description). A line that stays without response is sent again.
"""

from collections.abc import Callable
import threading
import time

from ivfmc_ros.devices.grbl import protocol
from ivfmc_ros.errors import ControllerLostError
from ivfmc_ros.errors import ControllerRefusedError
from ivfmc_ros.errors import DeviceError

# Error numbers that a transmission error can cause: no letter, no number, unknown command.
_TRANSMISSION_ERRORS = (1, 2, 3)
_FIRST_GCODE_ERROR = 20  # from here on the G-code itself is wrong, damaged on its way as a rule
_RESPONSE_TIMEOUT = 1.0  # seconds; GRBL answers within 10 ms unless it waits for a motion
_QUIET_TIME = 0.2  # seconds before a line is sent again, in which a late response is discarded
_ATTEMPTS = 2
_POLL_PERIOD = 0.05  # seconds between checks of ``busy`` during a wait


class PendingLine:
    """A line that was sent and has no response yet."""

    def __init__(self, text: str, on_ok: Callable[[], None] | None) -> None:
        self.text, self.on_ok = text, on_ok
        self.done = threading.Event()
        self.failure: DeviceError | None = None
        self.response = protocol.Response()


class CommandChannel:
    """
    Sends lines and matches them with responses. Thread safe.

    All lines must be idempotent, because a line whose response is lost is sent again.

    write : sends bytes
    is_busy : returns whether the controller has a reason not to respond yet, such as a motion
        that must end before an output is switched
    """

    def __init__(self, write: Callable[[bytes], None], is_busy: Callable[[], bool]) -> None:
        self._write, self._is_busy = write, is_busy
        self._pending: PendingLine | None = None
        self._pending_changed = threading.Condition()
        self._epoch = 0
        self._abort_reason: DeviceError | None = None

    @property
    def epoch(self) -> int:
        """Count of aborts; see ``send``."""
        return self._epoch

    def send(
        self, text: str, epoch: int | None = None, on_ok: Callable[[], None] | None = None
    ) -> None:
        """
        Send a line and wait for its response; send it again if there is none.

        epoch : value of ``epoch`` at the begin of the command that the line belongs to; the line
            is not sent if there was an abort since, so that nothing starts again after a stop
        on_ok : called in the reading thread when the response is ok
        :raises ControllerRefusedError: the controller responds with an error
        :raises ControllerLostError: there is no response
        :raises DeviceError: the reason of an abort
        """
        for attempt in range(_ATTEMPTS):
            is_last = attempt == _ATTEMPTS - 1
            pending = self._begin(text, on_ok, epoch)
            if not self._wait(pending):
                if is_last:
                    break
                time.sleep(_QUIET_TIME)
                continue
            if pending.failure is not None:
                raise pending.failure
            if pending.response.error is None:
                return
            if is_last or not _may_be_transmission_error(pending.response.error):
                raise _refusal(text, pending.response)
        raise ControllerLostError(
            f'{text}: no response from the controller, though the line was sent twice'
        )

    def send_without_waiting(self, text: str, on_ok: Callable[[], None], epoch: int) -> None:
        """
        Send a line; ``on_ok`` is called in the reading thread when the response is ok.

        epoch : as in ``send``
        :raises DeviceError: the port failed, or there was an abort
        """
        self._begin(text, on_ok, epoch)

    def handle_response(self, response: protocol.Response) -> None:
        """Complete the line in flight. A response without a line is ignored."""
        with self._pending_changed:
            pending, self._pending = self._pending, None
            self._pending_changed.notify_all()
        if pending is None:
            return
        pending.response = response
        if response.error is None and pending.on_ok is not None:
            pending.on_ok()
        pending.done.set()

    def abort(self, reason: DeviceError) -> None:
        """Abort the line in flight and all that wait to be sent; their senders get ``reason``."""
        with self._pending_changed:
            self._epoch += 1
            self._abort_reason = reason
            pending, self._pending = self._pending, None
            self._pending_changed.notify_all()
        if pending is not None:
            pending.failure = reason
            pending.done.set()

    def _begin(
        self, text: str, on_ok: Callable[[], None] | None, epoch: int | None
    ) -> PendingLine:
        """Wait until no line is in flight, then send."""
        with self._pending_changed:
            deadline = time.monotonic() + _RESPONSE_TIMEOUT
            while self._pending is not None:
                self._pending_changed.wait(_POLL_PERIOD)
                if self._is_busy():
                    deadline = time.monotonic() + _RESPONSE_TIMEOUT
                elif time.monotonic() > deadline:
                    # its response is lost: discard it
                    self._pending = None
            if epoch is not None and epoch != self._epoch and self._abort_reason is not None:
                raise self._abort_reason
            pending = self._pending = PendingLine(text, on_ok)
        try:
            self._write(text.encode('ascii') + b'\n')
        except DeviceError:
            with self._pending_changed:
                self._pending = None
                self._pending_changed.notify_all()
            raise
        return pending

    def _wait(self, pending: PendingLine) -> bool:
        """Return whether the line was completed before the timeout."""
        deadline = time.monotonic() + _RESPONSE_TIMEOUT
        while not pending.done.wait(_POLL_PERIOD):
            if self._is_busy():
                deadline = time.monotonic() + _RESPONSE_TIMEOUT
            elif time.monotonic() > deadline:
                with self._pending_changed:
                    if self._pending is pending:
                        self._pending = None
                        self._pending_changed.notify_all()
                return pending.done.is_set()
        return True


def _may_be_transmission_error(number: int) -> bool:
    return number in _TRANSMISSION_ERRORS or number >= _FIRST_GCODE_ERROR


def _refusal(text: str, response: protocol.Response) -> ControllerRefusedError:
    number = response.error or protocol.UNNUMBERED
    reason = protocol.ERRORS.get(number, 'see the list of error codes of the firmware')
    reason = response.text or reason
    return ControllerRefusedError(
        f'{text}: the controller responded with error {number}: {reason}'
    )
