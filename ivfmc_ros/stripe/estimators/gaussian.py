# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Weighted Gauss-Newton fit of a Gaussian on a constant background, vectorized over all rows.

The model of a row is exp(c0 + c1 x + c2 x^2) + b. Its derivatives are the Gaussian times
1, x, x^2, with the same x for all rows, so that every sum of the normal equations is a matrix
product. The weights are inverse variances of the fitted Gaussian by the noise model, not of the
noisy pixels, which would bias the fit to pixels that are dark by chance (Guo 2011, A Simple
Algorithm for Fitting a Gaussian Function, IEEE Signal Processing Magazine 28 (5)).
"""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.model import Floats
from ivfmc_ros.model import Singles
from ivfmc_ros.stripe.estimators import symmetric
from ivfmc_ros.stripe.estimators.patches import Patches
from ivfmc_ros.stripe.estimators.patches import PeakEstimate
from ivfmc_ros.stripe.estimators.patches import signal_to_noise
from ivfmc_ros.stripe.noise import SensorNoise

# Gauss-Newton iterations of the position estimate, and of the noise estimate (``residuals``).
_ITERATIONS = 3
_MANY_ITERATIONS = 8
# In the first iterations the variance of a pixel above the Gaussian is that of its own gray value:
# an initial Gaussian that is too narrow would give its flanks too much weight.
_CAUTIOUS_ITERATIONS = 2
# Largest change of the exponent within two sigmas per iteration (a factor of e^3).
_MAX_EXPONENT_STEP = 3.0
# The fitted sigma is limited to this factor of the detected one.
_MAX_WIDTH_RATIO = 2.5
# Standard deviation of the prior of the background: gray values, or a fraction of the height.
_BACKGROUND_SIGMA = 4.0
_BACKGROUND_FRACTION = 0.1
# Residuals of pixels with a larger leverage are not used for the noise estimate.
_MAX_LEVERAGE = 0.7
# Relative damping of the normal equations, for rows with too few pixels.
_DAMPING = 1e-6
# Upper limit of the exponent, against overflow.
_MAX_EXPONENT = 20.0


@dataclass(frozen=True, eq=False)
class _State:
    """
    The linearization of the fit at the current parameters.

    bell : (w, n) float32, gray values of the Gaussian without background
    residual : (w, n) float32, gray values
    weight : (w, n) float32, 1 / variance; 0 for unused pixels
    covariance : (6, n) of c0, c1, c2, in the order 00, 01, 02, 11, 12, 22
    step : (4, n), Gauss-Newton step of c
    """

    bell: Singles
    residual: Singles
    weight: Singles
    covariance: Floats
    step: Floats


class _Fit:
    """
    The fits of n rows.

    c : (4, n) parameters c0, c1, c2 and background b
    values, used : (w, n), transposed from the patches
    powers : (5, w), x^0 to x^4
    """

    def __init__(self, patches: Patches, noise: SensorNoise) -> None:
        rough = patches.rough
        # transposed, so that the arrays of one value per row broadcast
        self.values: Singles = np.ascontiguousarray(patches.values.T)
        self.used: Singles = np.ascontiguousarray(patches.used.T)
        self._pedestal = 0.0 if patches.pedestal is None else patches.pedestal.T
        self.powers: Singles = np.vander(patches.x, 5, increasing=True).T.astype(np.float32)
        self._noise = noise
        self._level = rough.level.astype(np.float64)
        share = np.maximum(_BACKGROUND_FRACTION * rough.height, _BACKGROUND_SIGMA).astype(
            np.float64
        )
        self._level_weight = share**-2
        self._sigma = np.maximum(rough.width.astype(np.float64), 0.7)
        position = (rough.column - patches.column).astype(np.float64) + rough.middle
        curvature = -0.5 / self._sigma**2
        height = np.log(np.maximum(rough.height, 1.0))
        self.c: Floats = np.stack(
            [height + curvature * position**2, -2.0 * curvature * position, curvature, self._level]
        )

    def run(self, steps: int = _ITERATIONS) -> _State:
        """Run a fixed number of iterations; return the linearization of the last one."""
        for step in range(steps):
            state = self._evaluate(cautious=step < _CAUTIOUS_ITERATIONS)
            self._move(state.step)
        return state

    def _evaluate(self, *, cautious: bool) -> _State:
        c = self.c.astype(np.float32)
        bell = np.exp(self.powers[:3].T @ c[:3])
        above = self.values - c[3]
        light: Singles = np.maximum(bell, above) if cautious else bell
        light = light + self._pedestal
        weight = self.used / self._noise.variance(light + c[3], light)
        residual = above - bell
        return _State(bell, residual, weight, *self._solve(bell, weight, residual))

    def _solve(self, bell: Singles, weight: Singles, residual: Singles) -> tuple[Floats, Floats]:
        """Return covariance and step; the background is eliminated by the Schur complement."""
        powers = self.powers
        by_bell = weight * bell
        squares = (powers @ (by_bell * bell)).astype(np.float64)
        mixed = (powers[:3] @ by_bell).astype(np.float64)
        rhs = (powers[:3] @ (by_bell * residual)).astype(np.float64)
        total = (powers[0] @ weight) + self._level_weight
        rhs_level = powers[0] @ (weight * residual)
        rhs_level = rhs_level + self._level_weight * (self._level - self.c[3])
        share = mixed / total
        matrix = squares[symmetric.SUM] - mixed[symmetric.FIRST] * share[symmetric.SECOND]
        matrix[symmetric.DIAGONAL] += _DAMPING * (1.0 + matrix[symmetric.DIAGONAL])
        covariance = symmetric.inverse(matrix)
        step = symmetric.multiply(covariance, rhs - share * rhs_level)
        level_step = (rhs_level - (mixed * step).sum(axis=0)) / total
        return covariance, np.concatenate([step, level_step[None]])

    def _move(self, step: Floats) -> None:
        two_sigma = 2.0 * self._sigma
        exponent_change = np.abs(step[0]) + two_sigma * (
            np.abs(step[1]) + two_sigma * np.abs(step[2])
        )
        step[:3] *= np.minimum(1.0, _MAX_EXPONENT_STEP / np.maximum(exponent_change, 1e-9))
        self.c += step
        bounds = (
            -0.5 / (self._sigma / _MAX_WIDTH_RATIO) ** 2,
            -0.5 / (self._sigma * _MAX_WIDTH_RATIO) ** 2,
        )
        self.c[2] = np.minimum(np.maximum(self.c[2], bounds[0]), bounds[1])


def fit(patches: Patches, noise: SensorNoise) -> PeakEstimate:
    """Fit every patch from its detected peak by a fixed number of Gauss-Newton iterations."""
    rows = _Fit(patches, noise)
    state = rows.run()
    c0, c1, c2, level = rows.c
    position, width = -0.5 * c1 / c2, np.sqrt(-0.5 / c2)
    height = np.exp(np.minimum(c0 - 0.25 * c1**2 / c2, _MAX_EXPONENT))
    # the position is a function of c: its variance is g^T C g
    sigma = symmetric.propagated_sigma(
        state.covariance, np.stack([0.0 * c2, -0.5 / c2, 0.5 * c1 / c2**2])
    )
    skew, skew_sigma = _skew(rows, state, position, width)
    return PeakEstimate(
        position=position,
        width=width,
        height=height,
        sigma=sigma,
        snr=signal_to_noise(height, width, level, noise),
        midpoint_distance=patches.midpoint_distance(position),
        misfit=_misfit(rows, state),
        skew=skew,
        skew_sigma=skew_sigma,
    )


def _skew(rows: _Fit, state: _State, position: Floats, width: Floats) -> tuple[Floats, Floats]:
    """
    Return the skew of each stripe, a fraction of its height, and its 1 sigma.

    It is the amplitude of an odd cubic in the residuals, orthogonal to a shift of the stripe.
    """
    x = rows.powers[1][:, None]
    t = (x - position.astype(np.float32)) / width.astype(np.float32)
    square = t * t
    one = rows.powers[0]
    by_bell = state.weight * state.bell
    by_square = by_bell * state.bell * square
    # weighted ratio of the fourth to the second moment makes the cubic orthogonal to a shift
    ratio = (one @ (by_square * square)) / np.maximum(one @ by_square, 1e-9)
    odd = t * (square - ratio)
    by_odd = by_bell * odd
    power = np.maximum(one @ (by_odd * odd * state.bell), 1e-9)
    skew = (one @ (by_odd * state.residual)) / power
    return skew.astype(np.float64), (power**-0.5).astype(np.float64)


def _misfit(rows: _Fit, state: _State) -> Floats:
    """Return the square root of chi^2 / dof less 3 of its own sigmas, 1 or more."""
    one = rows.powers[0]
    count = np.maximum(one @ rows.used - 4.0, 1.0)
    chi2 = (one @ (state.residual * state.residual * state.weight)) / count
    return np.asarray(np.sqrt(np.maximum(chi2 - 3.0 * np.sqrt(2.0 / count), 1.0)))


@dataclass(frozen=True, eq=False)
class Residuals:
    """
    Residuals of the pixels of fitted stripes, (n,) float64 each.

    total, laser : gray values of the model, with and without the background
    height : gray values, of the pixel's stripe
    position : of the pixel, in sigmas of the stripe from its center
    residual : gray values, divided by sqrt(1 - leverage)
    """

    total: Floats
    laser: Floats
    height: Floats
    position: Floats
    residual: Floats


def residuals(patches: Patches, noise: SensorNoise) -> Residuals:
    """Return the residuals of all used pixels whose leverage is small enough."""
    rows = _Fit(patches, noise)
    state = rows.run(_MANY_ITERATIONS)
    bell, weight = state.bell.T.astype(np.float64), state.weight.T.astype(np.float64)
    powers = rows.powers[:3].T.astype(np.float64)
    jacobian = np.concatenate([bell[..., None] * powers, np.ones((*bell.shape, 1))], axis=2)
    normal = np.einsum('nwi,nw,nwj->nij', jacobian, weight, jacobian)
    normal[:, [0, 1, 2, 3], [0, 1, 2, 3]] *= 1.0 + _DAMPING
    leverage = weight * np.einsum('nwi,nij,nwj->nw', jacobian, np.linalg.pinv(normal), jacobian)
    valid = (patches.used > 0) & (leverage < _MAX_LEVERAGE)
    c0, c1, c2, level = rows.c[..., None]
    height = np.exp(np.minimum(c0 - 0.25 * c1**2 / c2, _MAX_EXPONENT)) + 0.0 * bell
    return Residuals(
        total=(bell + level)[valid],
        laser=bell[valid],
        height=height[valid],
        position=((patches.x + 0.5 * c1 / c2) * np.sqrt(-2.0 * c2))[valid],
        residual=(state.residual.T[valid] / np.sqrt(1.0 - leverage[valid])).astype(np.float64),
    )
