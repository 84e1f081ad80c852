# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Smoothing along the stripe, for smooth parts: less noise for less detail.

Pieces of the stripe are smoothed apart. A straight line is fitted around each point, with
Gaussian weights over the rows and with what is known of each place, so that neither a slanted
stripe nor the end of a piece is moved.
"""

from itertools import pairwise

import numpy as np

from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.stripe.quality import piece_starts

# The weights end at so many of their sigmas.
_REACH = 3.0


def smooth(rows: Ints, u: Floats, sigma: Floats, width: float) -> tuple[Floats, Floats]:
    """
    Return smoothed places and their 1 sigma, (n,) pixels each.

    rows : (n,) ascending; u, sigma : (n,) pixels
    width : sigma of the weights, rows
    """
    u, sigma = u.copy(), sigma.copy()
    starts = piece_starts(rows, u)
    for first, after in pairwise(starts):
        piece = slice(first, after)
        u[piece], sigma[piece] = _smooth_piece(rows[piece], u[piece], sigma[piece], width)
    return u, sigma


def _smooth_piece(rows: Ints, u: Floats, sigma: Floats, width: float) -> tuple[Floats, Floats]:
    steps = np.arange(-np.ceil(_REACH * width), np.ceil(_REACH * width) + 1)
    kernel = np.exp(-0.5 * (steps / width) ** 2)
    row = rows - rows[0]
    known, place = np.zeros((2, row[-1] + 1))
    known[row] = sigma**-2
    # of the numbers near the piece nothing cancels
    place[row] = (u - u[0]) * known[row]

    def around(values: Floats, weights: Floats) -> Floats:
        whole = np.convolve(values, weights[::-1])
        return np.asarray(whole[len(steps) // 2 :][: len(values)][row])

    sums = [around(known, kernel * steps**power) for power in range(3)]
    pulls = [around(place, kernel * steps**power) for power in range(2)]
    determinant = sums[0] * sums[2] - sums[1] ** 2
    # two rows make a line and leave no noise out; one makes none
    enough = determinant > 1e-6 * sums[0] * sums[2]
    safe = np.where(enough, determinant, 1.0)
    middle = (sums[2] * pulls[0] - sums[1] * pulls[1]) / safe + u[0]
    squares = [around(known, kernel**2 * steps**power) for power in range(3)]
    variance = sums[2] ** 2 * squares[0] - 2.0 * sums[1] * sums[2] * squares[1]
    variance = (variance + sums[1] ** 2 * squares[2]) / safe**2
    return np.where(enough, middle, u), np.where(enough, np.sqrt(np.abs(variance)), sigma)
