# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""True table motion, laser power and triggers of a simulated cell, in memory that is shared."""

from collections.abc import Sequence
from pathlib import Path
import time

import numpy as np

from ivfmc_ros.devices.motion.trajectory import Segment
from ivfmc_ros.devices.motion.trajectory import Trajectory
from ivfmc_ros.errors import FileError
from ivfmc_ros.model import Floats

_MAGIC = 20261128.0  # marks the file format
_CAPACITY = 4096  # records of each ring; the oldest are overwritten
_RECORD_SIZE = 4  # numbers per record
# numbers: magic, version, counts of segments, laser changes, triggers, 3 unused
_HEADER_SIZE = 8
_MAX_RETRIES = 1000  # a write takes microseconds, but its process may lose the processor in it
_RETRY_S = 0.001
_RINGS = 3
_FILE_SIZE = _HEADER_SIZE + _RINGS * _CAPACITY * _RECORD_SIZE  # numbers


class _TruthFile:
    """
    Memory-mapped file: a header, and rings of segments, laser changes and triggers, all float64.

    A segment is (time, position, velocity, acceleration) as in Segment, in radians; it is valid
    until the next. A laser change is (time, power of the first laser, power of the second, 0), a
    trigger (time of the pulse, 0, 0, 0).
    Times are seconds of time.monotonic, which is the same for all processes. The version is odd
    during a write (a sequence lock), so that a reader knows when to read again.
    """

    def __init__(self, path: Path, mode: str) -> None:
        numbers = np.memmap(path, dtype=np.float64, mode=mode, shape=(_FILE_SIZE,))  # type: ignore[call-overload]
        self.header = numbers[:_HEADER_SIZE]
        rings = numbers[_HEADER_SIZE:].reshape(_RINGS, _CAPACITY, _RECORD_SIZE)
        self.segments, self.laser_changes, self.triggers = rings


class TruthWriter:
    """Creates and writes the file; there must be only one writer."""

    def __init__(self, path: Path) -> None:
        self._file = _TruthFile(path, 'w+')
        self._file.header[0] = _MAGIC
        self.write_motion(time.monotonic(), (Segment(time=0.0, position=0.0),))
        self.write_lasers(0.0, (0.0, 0.0))

    def write_motion(self, now: float, motion: Trajectory) -> None:
        """
        Replace the motion of the table from ``now`` on.

        motion : trajectory in radians
        """
        ring, count = self._file.segments, int(self._file.header[2])
        while count and ring[(count - 1) % _CAPACITY, 0] > now:
            count -= 1
        rows = np.array([(p.time, p.position, p.velocity, p.acceleration) for p in motion])
        if len(rows) == 1:
            rows[0, 0] = max(rows[0, 0], now)  # a standstill has no time of its own
        self._append(2, ring, count, rows)

    def write_lasers(self, now: float, powers: tuple[float, float]) -> None:
        """Set the powers of the lasers from ``now`` on, 0 to 1 of full power."""
        count = int(self._file.header[3])
        self._append(3, self._file.laser_changes, count, np.array([(now, *powers, 0.0)]))

    def write_triggers(self, times: Sequence[float]) -> None:
        """Add pulses of the trigger line, ascending."""
        rows = np.zeros((len(times), _RECORD_SIZE))
        rows[:, 0] = times
        self._append(4, self._file.triggers, int(self._file.header[4]), rows)

    def _append(self, counter: int, ring: Floats, count: int, rows: Floats) -> None:
        header = self._file.header
        header[1] += 1
        for row in rows:
            ring[count % _CAPACITY] = row
            count += 1
        header[counter] = count
        header[1] += 1


class TruthReader:
    """Reads the file that another process writes."""

    def __init__(self, path: Path) -> None:
        """
        Open the file.

        :raises FileError: there is no such file, or it has another format
        """
        try:
            self._file = _TruthFile(path, 'r')
        except (OSError, ValueError) as error:
            raise FileError(
                f'{path}: cannot be read: {error}; is the simulated cell running?'
            ) from error
        if self._file.header[0] != _MAGIC:
            raise FileError(f'{path}: is not the truth file of a simulated cell')

    def table_state(self, time: float) -> tuple[float, float]:
        """Return the true (position, velocity) of the table, radians (unwrapped) and rad/s."""
        rows = self._rows(2, self._file.segments)
        row = rows[max(int((rows[:, 0] <= time).sum()) - 1, 0)].tolist()
        segment = Segment(time=row[0], position=row[1], velocity=row[2], acceleration=row[3])
        return segment.state_at(max(time, row[0]))

    def mean_laser_powers(self, start: float, stop: float) -> Floats:
        """Return the mean power of each laser over an exposure, (2,), 0 to 1."""
        rows = self._rows(3, self._file.laser_changes)
        edges = np.clip(np.append(rows[:, 0], np.inf), start, stop)
        return np.asarray(np.diff(edges) @ rows[:, 1:3] / (stop - start))

    def triggers_after(self, time: float) -> list[float]:
        """Return the times of the pulses of the trigger line after ``time``, ascending."""
        times = self._rows(4, self._file.triggers)[:, 0]
        return [float(value) for value in times[times > time]]

    def _rows(self, counter: int, ring: Floats) -> Floats:
        """Return a consistent copy of a ring, the oldest first."""
        for _ in range(_MAX_RETRIES):
            version = self._file.header[1]
            count = int(self._file.header[counter])
            rows = (
                ring[:count] if count <= _CAPACITY else np.roll(ring, -(count % _CAPACITY), axis=0)
            )
            rows = np.array(rows)
            if version % 2 == 0 and version == self._file.header[1]:
                return rows
            time.sleep(_RETRY_S)
        raise FileError(
            'the truth file of the simulated cell changes during each attempt to read it'
        )
