# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Large arrays in parts that stay in the processor's cache, on all processors.

An array of more than 32 MB costs more than what is done to it: the system clears its pages anew
each time. NumPy lets other threads work during all that is long.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
import os


def in_parts(work: Callable[[slice], None], count: int, size: int) -> None:
    """Call ``work`` with slices of at most ``size`` that make up an array of ``count``."""
    parts = [slice(start, min(start + size, count)) for start in range(0, count, size)]
    if len(parts) < 2:
        for part in parts:
            work(part)
        return
    with ThreadPoolExecutor(os.cpu_count() or 1) as threads:
        for _ in threads.map(work, parts):
            pass
