# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What table and lasers really do, written by one process and read by others."""

from pathlib import Path
import time

import numpy as np

from ivfmc_ros.devices.motion.ramp import Motion
from ivfmc_ros.devices.motion.ramp import Piece
from ivfmc_ros.errors import FileError
from ivfmc_ros.model import Floats

_MAGIC = 20261123.0
_ROOM = 4096  # records of either kind; the oldest are forgotten
_WIDTH = 4
_HEADER = 8  # numbers: magic, version, motions, switchings
_RETRIES = 1000
_SIZE = _HEADER + 2 * _ROOM * _WIDTH


class _Record:
    """
    The file: a header, a ring of motions and a ring of switchings, all float64.

    A motion is (time, position, velocity, acceleration) as in Piece, in radians; it holds until
    the next. A switching is (time, power of the first laser, power of the second, 0). Times are
    seconds of time.monotonic, which is the same for all processes. The version is odd while
    the writer is at work, so that a reader knows when to read again.
    """

    def __init__(self, path: Path, mode: str) -> None:
        numbers = np.memmap(path, dtype=np.float64, mode=mode, shape=(_SIZE,))  # type: ignore[call-overload]
        self.header = numbers[:_HEADER]
        rings = numbers[_HEADER:].reshape(2, _ROOM, _WIDTH)
        self.motions, self.switchings = rings


class TruthWriter:
    """Makes the file; there must be one writer only."""

    def __init__(self, path: Path) -> None:
        self._record = _Record(path, 'w+')
        self._record.header[0] = _MAGIC
        self.motion(time.monotonic(), (Piece(time=0.0, position=0.0),))
        self.lasers(0.0, (0.0, 0.0))

    def motion(self, now: float, motion: Motion) -> None:
        """The table moves so from now on; what was said of later is void."""
        ring, count = self._record.motions, int(self._record.header[2])
        while count and ring[(count - 1) % _ROOM, 0] > now:
            count -= 1
        rows = np.array([(p.time, p.position, p.velocity, p.acceleration) for p in motion])
        if len(rows) == 1:
            rows[0, 0] = max(rows[0, 0], now)  # a rest is timeless
        self._append(2, ring, count, rows)

    def lasers(self, now: float, powers: tuple[float, float]) -> None:
        """The lasers shine so from now on, 0 to 1 of full power."""
        count = int(self._record.header[3])
        self._append(3, self._record.switchings, count, np.array([(now, *powers, 0.0)]))

    def _append(self, counter: int, ring: Floats, count: int, rows: Floats) -> None:
        header = self._record.header
        header[1] += 1
        for row in rows:
            ring[count % _ROOM] = row
            count += 1
        header[counter] = count
        header[1] += 1


class TruthReader:
    """Reads what the writer of another process has written."""

    def __init__(self, path: Path) -> None:
        """:raises FileError: there is no such file, or it is another."""
        try:
            self._record = _Record(path, 'r')
        except (OSError, ValueError) as error:
            raise FileError(
                f'{path}: cannot be read: {error}; is the simulated cell running?'
            ) from error
        if self._record.header[0] != _MAGIC:
            raise FileError(f'{path}: is no record of a simulated cell')

    def table(self, at: float) -> tuple[float, float]:
        """Return the table's position in radians (unwrapped) and its velocity."""
        rows = self._rows(2, self._record.motions)
        row = rows[max(int((rows[:, 0] <= at).sum()) - 1, 0)].tolist()
        piece = Piece(time=row[0], position=row[1], velocity=row[2], acceleration=row[3])
        return piece.at(max(at, row[0]))

    def lasers(self, start: float, stop: float) -> Floats:
        """Return the mean power of each laser over an exposure, (2,) of 0 to 1."""
        rows = self._rows(3, self._record.switchings)
        edges = np.clip(np.append(rows[:, 0], np.inf), start, stop)
        return np.asarray(np.diff(edges) @ rows[:, 1:3] / (stop - start))

    def _rows(self, counter: int, ring: Floats) -> Floats:
        """Return a consistent copy of a ring, the oldest first."""
        for _ in range(_RETRIES):
            version = self._record.header[1]
            count = int(self._record.header[counter])
            rows = ring[:count] if count <= _ROOM else np.roll(ring, -(count % _ROOM), axis=0)
            rows = np.array(rows)
            if version % 2 == 0 and version == self._record.header[1]:
                return rows
        raise FileError('the record of the simulated cell is being written all the time')
