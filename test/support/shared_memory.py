# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Shared-memory files of the middleware whose processes have ended."""

import fcntl
from pathlib import Path
import time

_FOLDER = Path('/dev/shm')
# ``ivfmc up`` leaves those that are younger to the next start, seconds.
_AGE_S = 6.0


def left_by_the_dead(since: float) -> int:
    """
    Return the bytes of the segments that no living process holds.

    since : time.time() from which they count
    """
    total = 0
    for lock in _FOLDER.glob('fastrtps_*_el'):
        segment = lock.with_name(lock.name.removesuffix('_el'))
        try:
            status = segment.stat()
            with lock.open('rb') as stream:
                fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            # a living process holds it, or it is gone
            continue
        if since < status.st_ctime < time.time() - _AGE_S:
            total += status.st_blocks * 512
    return total
