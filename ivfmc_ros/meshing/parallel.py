# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Thread-parallel processing of large arrays in chunks that fit in the processor's cache.

Temporary arrays of more than 32 MB cost more than the computation on them, because the operating
system clears their pages on each allocation. NumPy releases the GIL in all long operations, so
that the chunks run on all processors.
"""

from collections.abc import Callable
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
import os
from typing import TypeVar

_Result = TypeVar('_Result')


def run_chunked(work: Callable[[slice], None], count: int, size: int) -> None:
    """Call ``work`` with consecutive slices of at most ``size`` that cover ``range(count)``."""
    for _ in map_chunked(work, count, size):
        pass


def map_chunked(work: Callable[[slice], _Result], count: int, size: int) -> Iterator[_Result]:
    """Yield the results of ``work`` for consecutive slices that cover ``range(count)``."""
    chunks = [slice(start, min(start + size, count)) for start in range(0, count, size)]
    if len(chunks) < 2:
        yield from map(work, chunks)
        return
    with ThreadPoolExecutor(os.cpu_count() or 1) as threads:
        yield from threads.map(work, chunks)
