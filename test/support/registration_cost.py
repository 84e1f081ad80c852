# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the registration costs: time against points and views, memory a point."""

from collections.abc import Iterator
import resource
import time

import numpy as np

from bench import Number
from ivfmc_ros.model import Floats
from ivfmc_ros.model import View
from ivfmc_ros.registration.align import align

POINTS = (100_000, 1_000_000, 10_000_000)
VIEWS = (4, 16, 64)


def exponents() -> Iterator[Number]:
    """Time of two views against their points, and of small views against their number."""
    seconds = []
    before = _peak()
    for points in POINTS:
        rows = int(np.sqrt(points / 2))
        seconds.append(_timed([_wave(k, rows, 0.06, 0.0) for k in range(2)]))
    grown = _peak() - before
    note = ', '.join(f'{n:.0e}: {s:.1f} s' for n, s in zip(POINTS, seconds, strict=True))
    yield Number('time against points, exponent', _slope(POINTS, seconds), '', None, note)
    yield Number('peak memory a point', grown / POINTS[-1], 'byte', None, 'views included')
    seconds = [_timed([_wave(k, 100, 0.02, 0.008 * k) for k in range(n)]) for n in VIEWS]
    note = ', '.join(f'{n}: {s:.1f} s' for n, s in zip(VIEWS, seconds, strict=True))
    yield Number('time against views, exponent', _slope(VIEWS, seconds), '', None, note)


def _timed(views: list[View]) -> float:
    begin = time.perf_counter()
    align(views, 'joint')
    return time.perf_counter() - begin


def _wave(number: int, rows: int, size: float, along: float) -> View:
    """Return a square view of a wavy surface, the next one of a strip that overlaps."""
    x, y = np.meshgrid(np.linspace(0, size, rows) + along, np.linspace(0, size, rows))
    noise = 1e-5 * np.random.default_rng(number).standard_normal(x.shape)
    z = 2e-3 * np.sin(x / 4e-3) * np.cos(y / 5e-3) + noise + 5e-5 * (number % 2)
    ones = np.ones_like(z)
    return View(
        number=number,
        laser=0,
        points_xyz=np.stack([x, y, z], axis=2),
        intensity=ones,
        sigma=1e-5 * ones,
        uv=np.repeat(ones[..., None], 2, axis=2),
        angles=np.linspace(0, 1, rows),
        seqs=np.arange(rows),
    )


def _slope(sizes: tuple[int, ...], seconds: list[float]) -> float:
    fitted: Floats = np.polyfit(np.log(sizes), np.log(seconds), 1)
    return float(fitted[0])


def _peak() -> float:
    return 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
