# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Removes shared-memory files of Fast DDS whose process has ended, such as by SIGKILL.

A living process holds an advisory lock (``flock``) on the ``_el`` file of each of its segments,
also while it is stopped. The lock ends with the process, the files do not: 35 MB a node.
"""

import fcntl
import os
from pathlib import Path
import re
import time

_FOLDER = Path('/dev/shm')
_SEGMENT = re.compile(r'fastrtps_[0-9a-f]{16}')
# Files younger than this may belong to a process that has not locked them yet, seconds.
_LEAST_AGE_S = 5.0


def remove_dead_segments(folder: Path = _FOLDER, least_age_s: float = _LEAST_AGE_S) -> int:
    """
    Remove the segments of ended processes; those of living ones and of other users stay.

    :returns: number of bytes that were freed
    """
    freed = 0
    for path in sorted(folder.glob('fastrtps_*')) if folder.is_dir() else []:
        if _SEGMENT.fullmatch(path.name):
            freed += _remove_if_dead(path, least_age_s)
    return freed


def _remove_if_dead(segment: Path, least_age_s: float) -> int:
    lock = segment.with_name(f'{segment.name}_el')
    try:
        status = segment.stat()
        handle = os.open(lock, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        # gone in the meantime, or without a lock file by which its owner could be known
        return 0
    try:
        age_s = time.time() - max(status.st_ctime, os.fstat(handle).st_ctime)
        if age_s < least_age_s:
            return 0
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        segment.unlink()
        lock.unlink()
    except OSError:
        # a living process holds the lock, or the files belong to another user
        return 0
    finally:
        os.close(handle)
    return status.st_blocks * 512
