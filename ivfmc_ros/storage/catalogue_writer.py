# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Writes to the catalogue without holding up who has something to note."""

from collections import deque
from collections.abc import Callable
import queue
import threading

from ivfmc_ros.errors import CatalogueBusyError
from ivfmc_ros.storage.catalogue import Catalogue

# Seconds from one attempt to the next while somebody else holds the catalogue.
_RETRY_S = 0.5

Note = Callable[[Catalogue], None]


class Notes:
    """Notes for a catalogue, written in their order by a thread that waits for it."""

    def __init__(self, catalogue: Catalogue) -> None:
        self._refused = self._late = ''
        self._catalogue = catalogue
        self._queue: queue.Queue[Note | None] = queue.Queue()
        self._left: deque[Note] = deque()
        self._thread = threading.Thread(target=self._run, name='notes', daemon=True)
        self._thread.start()

    @property
    def error(self) -> str:
        """Why something is not written, '' when all is."""
        return self._refused or self._late

    def add(self, note: Note) -> None:
        """Write something as soon as that is possible."""
        self._queue.put(note)

    def close(self) -> None:
        """Write what is left, as far as the catalogue's patience lasts, and let go of it."""
        self._queue.put(None)
        self._thread.join()
        self._catalogue.close()

    def _run(self) -> None:
        while True:
            try:
                note = self._queue.get(timeout=_RETRY_S if self._left else None)
            except queue.Empty:
                self._write()
                continue
            if note is None:
                self._write()
                return
            self._left.append(note)
            if self._queue.empty():
                self._write()

    def _write(self) -> None:
        while self._left:
            try:
                self._left[0](self._catalogue)
            except CatalogueBusyError as error:
                # somebody else may only be looking into the file: it is tried again
                self._late = str(error)
                return
            except Exception as error:  # the next note shall be written all the same
                self._refused = str(error)
            self._left.popleft()
        self._late = ''
