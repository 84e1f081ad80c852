# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Writes to the catalogue in a thread, so that a locked database blocks no callback."""

from collections import deque
from collections.abc import Callable
import queue
import threading

from ivfmc_ros.errors import CatalogueBusyError
from ivfmc_ros.storage.catalogue.catalogue import Catalogue

# Time between two attempts while another process holds the lock, seconds.
_RETRY_S = 0.5

# A function that writes to the catalogue.
CatalogueUpdate = Callable[[Catalogue], None]


class CatalogueWriter:
    """
    Executes updates of a catalogue in their order in a thread.

    An update of a locked catalogue is repeated until it succeeds; one that fails otherwise is
    skipped, and ``error`` holds the reason.
    """

    def __init__(self, catalogue: Catalogue) -> None:
        """Start the thread; ``close`` closes the catalogue."""
        self._last_failure = self._lock_error = ''
        self._catalogue = catalogue
        self._queue: queue.Queue[CatalogueUpdate | None] = queue.Queue()
        self._pending: deque[CatalogueUpdate] = deque()
        self._thread = threading.Thread(target=self._run, name='catalogue', daemon=True)
        self._thread.start()

    @property
    def error(self) -> str:
        """Why an update has failed or is waiting; '' where all have succeeded."""
        return self._last_failure or self._lock_error

    def add(self, update: CatalogueUpdate) -> None:
        """Enqueue an update; returns at once."""
        self._queue.put(update)

    def close(self) -> None:
        """Execute the pending updates once more and close the catalogue; blocks meanwhile."""
        self._queue.put(None)
        self._thread.join()
        self._catalogue.close()

    def _run(self) -> None:
        while True:
            try:
                update = self._queue.get(timeout=_RETRY_S if self._pending else None)
            except queue.Empty:
                self._write_pending()
                continue
            if update is None:
                self._write_pending()
                return
            self._pending.append(update)
            if self._queue.empty():
                self._write_pending()

    def _write_pending(self) -> None:
        while self._pending:
            try:
                self._pending[0](self._catalogue)
            except CatalogueBusyError as error:
                # another process holds the lock, maybe only to read: try again later
                self._lock_error = str(error)
                return
            except Exception as error:  # a failed update must not stop the following ones
                self._last_failure = str(error)
            self._pending.popleft()
        self._lock_error = ''
