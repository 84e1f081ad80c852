# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Writes to the catalogue in a thread, so that a locked or absent database blocks no callback."""

from collections import deque
from collections.abc import Callable
import queue
import threading
import time

from ivfmc_ros.errors import CatalogueBusyError
from ivfmc_ros.storage.catalogue.catalogue import Catalogue

# Time between two attempts while another process holds the lock, or the server is away, seconds.
_RETRY_S = 0.5
# ``close`` waits so long, seconds, for a database that cannot be written.
_CLOSE_S = 2.0

# A function that writes to the catalogue.
CatalogueUpdate = Callable[[Catalogue], object]


class CatalogueWriter:
    """
    Executes updates of a catalogue in their order in a thread.

    An update is repeated while the database is locked or its server is away; one that fails
    otherwise is skipped, and ``error`` holds the reason.
    """

    def __init__(self, catalogue: Catalogue) -> None:
        """Start the thread, which closes the catalogue at its end."""
        self._last_failure = self._busy_error = ''
        self._catalogue = catalogue
        self._queue: queue.Queue[CatalogueUpdate | None] = queue.Queue()
        self._pending: deque[CatalogueUpdate] = deque()
        self._thread = threading.Thread(target=self._run, name='catalogue', daemon=True)
        self._thread.start()

    @property
    def error(self) -> str:
        """Why an update has failed or is waiting; '' where all have succeeded."""
        return self._last_failure or self._busy_error

    @property
    def is_done(self) -> bool:
        """Whether the catalogue is closed, with all updates written or skipped."""
        return not self._thread.is_alive()

    def add(self, update: CatalogueUpdate) -> None:
        """Enqueue an update; returns at once."""
        self._queue.put(update)

    def close(self) -> None:
        """
        Execute the pending updates and close the catalogue; blocks for at most a few seconds.

        Updates for which the database is still locked or away are repeated in the background, as
        long as the process lives; ``ivfmc scans rebuild`` writes the rows of those that are lost
        with it.
        """
        self._queue.put(None)
        deadline = time.monotonic() + _CLOSE_S
        while self._thread.is_alive():
            self._thread.join(0.05)
            if self._busy_error and time.monotonic() > deadline:
                return

    def _run(self) -> None:
        is_closing = False
        while not (is_closing and not self._pending):
            try:
                update = self._queue.get(timeout=_RETRY_S if self._pending else None)
            except queue.Empty:
                self._write_pending()
                continue
            if update is None:
                is_closing = True
                self._write_pending()
                continue
            self._pending.append(update)
            if self._queue.empty():
                self._write_pending()
        self._catalogue.close()

    def _write_pending(self) -> None:
        while self._pending:
            try:
                self._pending[0](self._catalogue)
            except CatalogueBusyError as error:
                # another process holds the lock, maybe only to read, or the server is away
                self._busy_error = str(error)
                return
            except Exception as error:  # a failed update must not stop the following ones
                self._last_failure = str(error)
            self._pending.popleft()
        self._busy_error = ''
