# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Large arrays in parts that stay in the processor's cache, on all processors.

An array of more than 32 MB costs more than what is done to it: the system clears its pages anew
each time. NumPy lets other threads work during all that is long.
"""

from collections.abc import Callable
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
import os
from typing import TypeVar

_Result = TypeVar('_Result')


def in_parts(work: Callable[[slice], None], count: int, size: int) -> None:
    """Call ``work`` with slices of at most ``size`` that make up an array of ``count``."""
    for _ in each_part(work, count, size):
        pass


def each_part(work: Callable[[slice], _Result], count: int, size: int) -> Iterator[_Result]:
    """Give what ``work`` returns for slices that make up an array, in their order."""
    parts = [slice(start, min(start + size, count)) for start in range(0, count, size)]
    if len(parts) < 2:
        yield from map(work, parts)
        return
    with ThreadPoolExecutor(os.cpu_count() or 1) as threads:
        yield from threads.map(work, parts)
