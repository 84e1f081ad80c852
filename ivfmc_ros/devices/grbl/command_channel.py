# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One line in flight: each that is sent waits for its answer before the next is sent."""

from collections.abc import Callable
import threading
import time

from ivfmc_ros.devices.grbl import protocol
from ivfmc_ros.errors import BoardLostError
from ivfmc_ros.errors import BoardRefusedError
from ivfmc_ros.errors import DeviceError

# A line may have been damaged on its way, if it is one of these that the board complains about.
_DAMAGED = (1, 2, 3)
_PATIENCE = 1.0  # seconds for the answer of a board that has nothing else to do
_QUIET = 0.2  # seconds, in which an answer that came too late is thrown away
_TRIES = 2


class Pending:
    """A line that was sent."""

    def __init__(self, text: str, then: Callable[[], None] | None) -> None:
        self.text, self.then = text, then
        self.done = threading.Event()
        self.error: DeviceError | None = None
        self.refused: int | None = None
        self.sent = time.monotonic()


class Conversation:
    """
    Sends lines and matches them with answers.

    All lines must be such that sending one again does no harm, because an answer may get lost.

    write : sends bytes
    busy : tells whether the board has a reason not to answer yet, such as a motion that a
        laser line waits for
    """

    def __init__(self, write: Callable[[bytes], None], busy: Callable[[], bool]) -> None:
        self._write, self._busy = write, busy
        self._pending: Pending | None = None
        self._free = threading.Condition()
        self._epoch = 0
        self._reason: DeviceError | None = None

    @property
    def epoch(self) -> int:
        """How often lines were given up; see ``send``."""
        return self._epoch

    def send(self, text: str, epoch: int | None = None) -> None:
        """
        Send a line and wait for its answer, sending it again when it seems to have got lost.

        epoch : of the time when the command began that the line belongs to; if lines were given
            up since, this one is too, so that nothing begins again after a stop
        :raises BoardRefusedError: the board says that it is wrong
        :raises DeviceError: it was given up, see ``fail``, or there is no answer
        """
        for attempt in range(_TRIES):
            last = attempt == _TRIES - 1
            pending = self._begin(text, None, epoch)
            if not self._wait(pending):
                if last:
                    break
                time.sleep(_QUIET)
                continue
            if pending.error is not None:
                raise pending.error
            if pending.refused is None:
                return
            if last or not self._was_damaged(pending.refused):
                raise _refused(text, pending.refused)
        raise BoardLostError(f'{text}: the board does not answer, though it was sent twice')

    def begin(self, text: str, then: Callable[[], None], epoch: int) -> None:
        """Send a line; ``then`` is called in the reading thread when it is answered by ok."""
        self._begin(text, then, epoch)

    def answer(self, error: int | None) -> None:
        """The board said ok or error; without a line in flight nothing happens."""
        with self._free:
            pending, self._pending = self._pending, None
            self._free.notify_all()
        if pending is None:
            return
        pending.refused = error
        pending.done.set()
        if error is None and pending.then is not None:
            pending.then()

    def fail(self, error: DeviceError) -> None:
        """Give the line in flight up, and what waits behind it."""
        with self._free:
            self._epoch += 1
            self._reason = error
            pending, self._pending = self._pending, None
            self._free.notify_all()
        if pending is not None:
            pending.error = error
            pending.done.set()

    def _begin(self, text: str, then: Callable[[], None] | None, epoch: int | None) -> Pending:
        with self._free:
            deadline = time.monotonic() + _PATIENCE
            while self._pending is not None:
                self._free.wait(0.05)
                if self._busy():
                    deadline = time.monotonic() + _PATIENCE
                elif time.monotonic() > deadline:
                    # its sender has given up, or nobody waits for it
                    self._pending = None
            if epoch is not None and epoch != self._epoch and self._reason is not None:
                raise self._reason
            pending = self._pending = Pending(text, then)
        try:
            self._write(text.encode('ascii') + b'\n')
        except DeviceError:
            with self._free:
                self._pending = None
                self._free.notify_all()
            raise
        return pending

    def _wait(self, pending: Pending) -> bool:
        deadline = time.monotonic() + _PATIENCE
        while not pending.done.wait(0.05):
            if self._busy():
                deadline = time.monotonic() + _PATIENCE
            elif time.monotonic() > deadline:
                with self._free:
                    if self._pending is pending:
                        self._pending = None
                        self._free.notify_all()
                return pending.done.is_set()
        return True

    @staticmethod
    def _was_damaged(error: int) -> bool:
        return error in _DAMAGED or error >= 20


def _refused(text: str, number: int) -> BoardRefusedError:
    reason = protocol.ERRORS.get(number, 'see the list of error codes of GRBL 1.1')
    return BoardRefusedError(f'{text}: refused with error {number}: {reason}')
