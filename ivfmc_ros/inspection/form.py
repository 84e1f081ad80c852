# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Form error of a fitted shape: range of its residuals (ISO 1101) without the part of the noise.

The range of single vertices grows with their number and noise. Residuals are therefore averaged
over patches, and the range that the noise of the patches has on a perfect shape is subtracted.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import ndtri

from ivfmc_ros.model import Floats

# Edge of a patch, meters: about the width of the stripe.
_PATCH = 1.5e-3
_MIN_VERTICES = 5  # of a patch
_MIN_PATCHES = 8  # of a feature
# Median of the absolute value of a normal variable, sigmas.
_MAD = 0.6745
# Width of a uniform distribution in its standard deviations (GUM 4.3.7).
_UNIFORM = float(np.sqrt(12.0))


@dataclass(frozen=True, kw_only=True)
class FormError:
    """Form error and its standard uncertainty due to noise, meters; NaN with too few patches."""

    value: float
    noise_u: float


def form_error(points_xyz: Floats, residuals: Floats) -> FormError:
    """
    Return the form error of a shape.

    points_xyz : (n, 3) meters; residuals : (n,) meters, their signed distances from the shape
    """
    cells = np.floor(points_xyz / _PATCH).astype(np.int64)
    _, patch, count = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    patch = patch.ravel()
    full = count >= _MIN_VERTICES
    if np.count_nonzero(full) < _MIN_PATCHES:
        return FormError(value=float('nan'), noise_u=float('nan'))
    means = (np.bincount(patch, residuals) / count)[full]
    centers = np.stack([np.bincount(patch, x) / count for x in points_xyz.T], axis=1)[full]
    # the shape of the part is smooth from patch to patch, the noise is not
    neighbor = cKDTree(centers).query(centers, k=2)[1][:, 1]
    steps = means - means[neighbor]
    sigma = float(np.median(np.abs(steps)) / _MAD / np.sqrt(2.0))
    spread = float(np.ptp(means))
    # expected range of as many normal variables (Blom 1958)
    noise = 2.0 * float(ndtri((len(means) - 0.375) / (len(means) + 0.25))) * sigma
    value = float(np.sqrt(max(spread**2 - noise**2, 0.0)))
    # both extremes err; the part of the noise in the range is between none and all of it
    return FormError(value=value, noise_u=float(np.hypot(np.sqrt(2.0) * sigma, noise / _UNIFORM)))
