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

from ivfmc_ros.inspection.features import Feature
from ivfmc_ros.inspection.features import residuals as residuals_of
from ivfmc_ros.model import Floats

# Edge of a patch, meters: about the width of the stripe.
_PATCH = 1.5e-3
# Least number of vertices of a patch, and that as a fraction of the median of all patches.
_MIN_VERTICES, _MIN_SHARE = 5, 0.5
_MIN_PATCHES = 8  # of a feature, a section or a line
_MIN_TURN = 0.4  # fraction of a circle that the patches of a section must cover
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
    patches = _Patches.of(np.floor(points_xyz / _PATCH), points_xyz, residuals)
    if len(patches.means) < _MIN_PATCHES:
        return _UNKNOWN
    return _without_noise(float(np.ptp(patches.means)), len(patches.means), patches.sigma)


def roundness(shape: Feature, points_xyz: Floats) -> FormError:
    """
    Return the roundness of a cylinder: the largest form error of its sections, from their circles.

    shape : fitted to the points (n, 3), meters
    """
    patches = _unrolled(shape, points_xyz)
    angle = patches.centers[:, 0] / (0.5 * shape.diameter)
    columns = np.stack([np.ones(len(angle)), np.cos(angle), np.sin(angle)], axis=1)
    turn = max(int(np.pi * shape.diameter / _PATCH), 1)
    least = max(_MIN_PATCHES, int(_MIN_TURN * turn))
    return _largest(patches, patches.cells[:, 1], columns, least)


def straightness(shape: Feature, points_xyz: Floats) -> FormError:
    """
    Return the straightness of the lines along a cylinder: the largest of all lines.

    shape : fitted to the points (n, 3), meters
    """
    patches = _unrolled(shape, points_xyz)
    columns = np.stack([np.ones(len(patches.means)), patches.centers[:, 1]], axis=1)
    return _largest(patches, patches.cells[:, 0], columns, _MIN_PATCHES)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Patches:
    """
    Means over k patches of the residuals of a shape.

    cells : (k, d) index of each patch; centers : (k, d) meters; means : (k,) meters
    sigma : meters, 1 sigma of the noise of a mean; NaN with fewer than two patches
    """

    cells: Floats
    centers: Floats
    means: Floats
    sigma: float

    @classmethod
    def of(cls, cells: Floats, places: Floats, residuals: Floats) -> '_Patches':
        """Average residuals (n,) at places (n, d) over cells (n, d); sparse ones are left out."""
        kinds, patch, count = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
        patch = patch.ravel()
        # the means of patches that a border cuts are noisier than the others
        full = count >= max(_MIN_VERTICES, _MIN_SHARE * float(np.median(count)))
        means = (np.bincount(patch, residuals) / count)[full]
        centers = np.stack([np.bincount(patch, x) / count for x in places.T], axis=1)[full]
        sigma = float('nan')
        if len(means) > 1:
            # the shape of the part is smooth from patch to patch, the noise is not
            neighbor = cKDTree(centers).query(centers, k=2)[1][:, 1]
            steps = np.abs(means - means[neighbor])
            sigma = float(np.median(steps) / _MAD / np.sqrt(2.0))
        return cls(cells=kinds[full], centers=centers, means=means, sigma=sigma)


def _unrolled(shape: Feature, points_xyz: Floats) -> _Patches:
    """Return patches of an unrolled cylinder, by their arc around it and height along it."""
    offset = points_xyz - shape.center_xyz
    basis = np.linalg.svd(shape.axis[None])[2][1:]
    x, y = basis @ offset.T
    places = np.stack([0.5 * shape.diameter * np.arctan2(y, x), offset @ shape.axis], axis=1)
    return _Patches.of(np.floor(places / _PATCH), places, residuals_of(shape, points_xyz))


def _largest(patches: _Patches, group: Floats, columns: Floats, least: int) -> FormError:
    """
    Return the largest range of a group's means after a linear fit of columns (k, c).

    least : number of patches of a group that is evaluated
    """
    spread, count = float('nan'), 0
    for number in np.unique(group):
        own = np.flatnonzero(group == number)
        if len(own) < least:
            continue
        means, A = patches.means[own], columns[own]
        rest = means - A @ np.linalg.lstsq(A, means, rcond=None)[0]
        spread, count = float(np.fmax(spread, np.ptp(rest))), count + len(own)
    # the largest of all groups has nearly the noise of a single range of all patches
    return _without_noise(spread, count, patches.sigma) if count else _UNKNOWN


def _without_noise(spread: float, count: int, sigma: float) -> FormError:
    """Return a range of ``count`` means without the part of their noise of 1 ``sigma``."""
    # expected range of as many normal variables (Blom 1958)
    noise = 2.0 * float(ndtri((count - 0.375) / (count + 0.25))) * sigma
    value = float(np.sqrt(max(spread**2 - noise**2, 0.0)))
    # both extremes err; the part of the noise in the range is between none and all of it
    return FormError(value=value, noise_u=float(np.hypot(np.sqrt(2.0) * sigma, noise / _UNIFORM)))


_UNKNOWN = FormError(value=float('nan'), noise_u=float('nan'))
