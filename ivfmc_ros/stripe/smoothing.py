# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Smoothing of stripe positions along the stripe by local linear regression.

Each connected segment is smoothed separately. A line is fitted convolved each point, weighted by a
Gaussian over the rows and by the inverse variance of each position; neither a slanted stripe nor
the end of a segment is biased. For smooth parts: less noise at the cost of detail.
"""

from itertools import pairwise

import numpy as np

from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.stripe.quality import segment_starts

# Half width of the Gaussian kernel, in its sigmas.
_KERNEL_SIGMAS = 3.0


def smooth(rows: Ints, u: Floats, sigma: Floats, width: float) -> tuple[Floats, Floats]:
    """
    Return smoothed positions and their 1 sigma, (n,) pixels each.

    rows : (n,) ascending; u, sigma : (n,) pixels
    width : sigma of the weights, rows
    """
    u, sigma = u.copy(), sigma.copy()
    starts = segment_starts(rows, u)
    for first, after in pairwise(starts):
        segment = slice(first, after)
        u[segment], sigma[segment] = _smooth_segment(
            rows[segment], u[segment], sigma[segment], width
        )
    return u, sigma


def _smooth_segment(rows: Ints, u: Floats, sigma: Floats, width: float) -> tuple[Floats, Floats]:
    steps = np.arange(-np.ceil(_KERNEL_SIGMAS * width), np.ceil(_KERNEL_SIGMAS * width) + 1)
    kernel = np.exp(-0.5 * (steps / width) ** 2)
    row = rows - rows[0]
    weight, weighted = np.zeros((2, row[-1] + 1))
    weight[row] = sigma**-2
    # relative to the first position, against loss of precision
    weighted[row] = (u - u[0]) * weight[row]

    def convolved(values: Floats, weights: Floats) -> Floats:
        whole = np.convolve(values, weights[::-1])
        return np.asarray(whole[len(steps) // 2 :][: len(values)][row])

    sums = [convolved(weight, kernel * steps**power) for power in range(3)]
    rhs = [convolved(weighted, kernel * steps**power) for power in range(2)]
    determinant = sums[0] * sums[2] - sums[1] ** 2
    # a single row does not determine a line
    determined = determinant > 1e-6 * sums[0] * sums[2]
    safe = np.where(determined, determinant, 1.0)
    smoothed = (sums[2] * rhs[0] - sums[1] * rhs[1]) / safe + u[0]
    squares = [convolved(weight, kernel**2 * steps**power) for power in range(3)]
    variance = sums[2] ** 2 * squares[0] - 2.0 * sums[1] * sums[2] * squares[1]
    variance = (variance + sums[1] ** 2 * squares[2]) / safe**2
    return np.where(determined, smoothed, u), np.where(
        determined, np.sqrt(np.abs(variance)), sigma
    )
