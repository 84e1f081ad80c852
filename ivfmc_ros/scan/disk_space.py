# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Free space for a scan: required before it starts, and watched while it records.

A bag that is closed while there is still room is complete, and the next scan can begin when space
was freed; one that ends by a failed write has to be repaired.
"""

from collections.abc import Callable
from pathlib import Path
import shutil
import time

from ivfmc_ros.errors import DiskFullError
from ivfmc_ros.errors import FileError

# Seconds between two looks at the disk.
_PERIOD_S = 1.0
_MB = 1e6


def free_bytes(folder: Path) -> int:
    """:raises FileError: the folder cannot be looked up."""
    try:
        return shutil.disk_usage(folder).free
    except OSError as error:
        raise FileError(f'{folder}: cannot be looked up: {error.strerror or error}') from error


class DiskWatch:
    """
    The space of the scans while one is taken.

    reserve : bytes that stay free, so that bag and mesh can be written to their end
    """

    def __init__(
        self,
        folder: Path,
        reserve: float,
        *,
        free: Callable[[Path], int] = free_bytes,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """``free``, ``clock``: return free bytes of a folder, and seconds."""
        self._folder, self._reserve = folder, reserve
        self._free, self._clock = free, clock
        self._looked_s = -_PERIOD_S

    def require_room(self, expected: float) -> None:
        """
        Check that a scan fits.

        expected : bytes that it is likely to take
        :raises DiskFullError: it does not
        """
        free = self._free(self._folder)
        if free - expected < self._reserve:
            raise DiskFullError(
                f'{self._folder}: {free / _MB:.0f} MB are free; the scan takes about '
                f'{expected / _MB:.0f} MB, and min_free_space keeps {self._reserve / _MB:.0f} MB: '
                'free space, then start the scan again'
            )

    def require_reserve(self) -> None:
        """:raises DiskFullError: less than the reserve is free; looks once a second."""
        now_s = self._clock()
        if now_s - self._looked_s < _PERIOD_S:
            return
        self._looked_s = now_s
        free = self._free(self._folder)
        if free < self._reserve:
            raise DiskFullError(
                f'{self._folder}: only {free / _MB:.0f} MB are free, less than the '
                f'{self._reserve / _MB:.0f} MB of min_free_space; what was taken is kept: free '
                'space, then scan again'
            )


class SpaceEstimate:
    """Bytes that a planned profile takes on disk, by the last scan of this orchestrator."""

    def __init__(self) -> None:
        self._bytes_per_profile = 0.0

    def learn(self, folder: Path, profiles: int) -> None:
        """Take over what a complete scan took: its folder, and its planned profiles."""
        if profiles <= 0:
            return
        try:
            sizes = [path.stat().st_size for path in folder.iterdir() if path.is_file()]
        except OSError:
            # deleted in the meantime
            return
        self._bytes_per_profile = sum(sizes) / profiles

    def of(self, profiles: int) -> float:
        """Return the bytes that a scan is likely to take; 0 before the first one."""
        return self._bytes_per_profile * profiles
