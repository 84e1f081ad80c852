# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Work on all cores: a process a core, each with one thread."""

from collections.abc import Callable
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
import os
from typing import TypeVar
from unittest.mock import patch

Item = TypeVar('Item')
Result = TypeVar('Result')

_ONE_THREAD = dict.fromkeys(('OPENBLAS_NUM_THREADS', 'OMP_NUM_THREADS', 'MKL_NUM_THREADS'), '1')


def mapped(work: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """Return ``work`` of each item; both go to fresh processes."""
    with (
        patch.dict(os.environ, _ONE_THREAD),
        ProcessPoolExecutor(os.cpu_count(), mp_context=get_context('spawn')) as pool,
    ):
        return list(pool.map(work, items))


def alone(work: Callable[[], Result]) -> Result:
    """Return what ``work`` gives in a fresh process with all threads, whose memory is its own."""
    with ProcessPoolExecutor(1, mp_context=get_context('spawn')) as pool:
        return pool.submit(work).result()
