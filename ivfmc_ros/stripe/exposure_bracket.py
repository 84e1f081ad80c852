# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Merging of the stripes of several exposures of one table angle, row by row.

On metal, one part of the stripe is clipped where another is too dim; hardly any is both in all
exposures. Every exposure is searched by itself, with the noise of its own pixels, and each row
takes the position with the least sigma. They are not averaged: speckle is the same in all.
"""

from collections.abc import Sequence

import numpy as np

from ivfmc_ros.cell.laser import Stripe as Direction
from ivfmc_ros.stripe.stripe import Stripe

# Greatest difference of two positions of the same stripe: pixels, and their common sigmas.
_MAX_DIFFERENCE, _MAX_SIGMAS = 0.5, 3.0


def merge_exposures(stripes: Sequence[Stripe], direction: Direction) -> Stripe:
    """
    Return the most certain position of each row (or column, by ``direction``) of several stripes.

    A row is dropped if as many exposures contradict this position as confirm it (itself included).
    """
    every = Stripe.concatenated(stripes)
    along, across = (1, 0) if direction == 'rows' else (0, 1)
    line = np.rint(every.uv[:, along]).astype(np.int64)
    order = np.lexsort((every.sigma, line))
    every, line = every[order], line[order]
    starts = np.flatnonzero(np.diff(line, prepend=-1))
    count = np.diff(np.append(starts, len(line)))
    best = np.repeat(starts, count)
    difference = np.abs(every.uv[:, across] - every.uv[best, across])
    tolerance = np.maximum(_MAX_DIFFERENCE, _MAX_SIGMAS * np.hypot(every.sigma, every.sigma[best]))
    if not len(line):
        return every
    confirming = np.add.reduceat((difference <= tolerance).astype(np.int64), starts)
    return every[starts[2 * confirming > count]]
