# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Weights of the residuals: noise levels from the residuals themselves, and Huber's function.

Corners of one kind have one noise level. A stripe has the noise of its pixels, and errors that are
common to the whole stripe (offset, slope, curvature: a board that flexes, blur of the corners)
with one variance component for boards and one for the platter, estimated by moments.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ivfmc_ros.calibration.joint.residuals import PictureResiduals
from ivfmc_ros.model import Floats

# Huber's constant in sigmas: 95 % efficiency for normal noise (Huber 1964)
_HUBER = 1.345
# median distance from zero of normal noise of 1 sigma in two dimensions
_MEDIAN_OF_RAYLEIGH = 1.1774
_MIN_CORNER_SIGMA = 1e-4  # pixels
# meters: a stripe residual is not better than this, a tenth of the finest resolution
_MIN_STRIPE_SIGMA = 1e-7


@dataclass(frozen=True, kw_only=True)
class NoiseLevels:
    """
    Standard deviations.

    board, platter : pixels, of a coordinate of a corner; the second with the correlation between
        pictures
    board_stripe, platter_stripe : meters, of each error common to one stripe
    """

    board: float
    platter: float
    board_stripe: float
    platter_stripe: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Weights:
    """
    Inverse covariance of the residuals of one kind in one picture.

    variance : (m,) of each residual by itself, enlarged for outliers
    common : (m, s) square root of the covariance that residuals share
    """

    variance: Floats
    common: Floats

    def apply(self, columns: Floats) -> Floats:
        """Return C^-1 columns, (m, k), with C = diag(variance) + common common' (Woodbury)."""
        scaled = columns / self.variance[:, None]
        if not self.common.shape[1]:
            return scaled
        gain = self.common / self.variance[:, None]
        inner = np.eye(self.common.shape[1]) + self.common.T @ gain
        return np.asarray(scaled - gain @ np.linalg.solve(inner, self.common.T @ scaled))


def corner_sigma(residuals: Sequence[PictureResiduals]) -> float:
    """Return the robust standard deviation of a coordinate of the corners, pixels."""
    off = np.concatenate([np.linalg.norm(r.values.reshape(-1, 2), axis=1) for r in residuals])
    return max(float(np.median(off)) / _MEDIAN_OF_RAYLEIGH, _MIN_CORNER_SIGMA)


def stripe_sigma(residuals: Sequence[PictureResiduals]) -> float:
    """Return the standard deviation of each error common to a stripe, meters (by moments)."""
    excess = []
    for seen in residuals:
        projector = np.linalg.pinv(seen.shapes)
        expected = (projector**2) @ seen.pixel_sigma**2
        excess.append((projector @ seen.values) ** 2 - expected)
    if not excess:
        return 0.0
    # the median over stripes, so that one that is wrong does not decide
    middle = float(np.median(np.mean(excess, axis=1)))
    return float(np.sqrt(max(middle, 0.0)))


def corner_weights(seen: PictureResiduals, sigma: float) -> Weights:
    """Return the weights of corners with the noise ``sigma``, pixels."""
    off = np.linalg.norm(seen.values.reshape(-1, 2), axis=1)
    robust = np.minimum(1.0, _HUBER * np.sqrt(2.0) * sigma / np.maximum(off, 1e-12))
    return Weights(variance=np.repeat(sigma**2 / robust, 2), common=seen.shapes)


def stripe_weights(seen: PictureResiduals, sigma: float) -> Weights:
    """Return the weights of a stripe with common errors of ``sigma``, meters."""
    own = np.maximum(seen.pixel_sigma, _MIN_STRIPE_SIGMA) ** 2
    total = np.sqrt(own + sigma**2 * (seen.shapes**2).sum(axis=1))
    robust = np.minimum(1.0, _HUBER * total / np.maximum(np.abs(seen.values), 1e-15))
    return Weights(variance=own / robust, common=sigma * seen.shapes)
