# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Maximum-likelihood fit of a Gaussian stripe on a level background, all rows at once.

The model of a row is exp(c0 + c1 x + c2 x^2) + b. Its derivatives are the bell itself times
1, x, x^2, with the same x for all rows, so that every sum of the normal equations is a matrix
product. Pixels weigh by the variance that the noise model gives to the fitted bell, not to the
noisy pixel, which would pull the fit to what is dark by chance (the pitfall that Guo 2011, IEEE
Signal Processing Magazine 28 (5), describes for the logarithmic fit).
"""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.model import Floats
from ivfmc_ros.model import Singles
from ivfmc_ros.stripe.estimators import symmetric
from ivfmc_ros.stripe.estimators.patches import Estimate
from ivfmc_ros.stripe.estimators.patches import Patches
from ivfmc_ros.stripe.estimators.patches import signal_to_noise
from ivfmc_ros.stripe.noise import Noise

_STEPS = 3
_MANY_STEPS = 8
# In the first steps a pixel brighter than the bell counts as noisy as its own brightness says:
# where the bell starts too narrow, its dark flanks would seem to be known exactly.
_CAUTIOUS = 2
# A step may change the bell by at most this factor (e^3) within two sigmas.
_LARGEST = 3.0
# The fitted sigma stays within this factor of the rough one.
_STRETCH = 2.5
# How well the sides of a peak tell the background: grey values, and shares of its height.
_LEVEL_SIGMA = 4.0
_LEVEL_SHARE = 0.1


# A pixel of which the fit takes more than this share tells nothing of its noise.
_TAKEN = 0.7
# Keeps the equations of a row with too few pixels solvable.
_RIDGE = 1e-6


@dataclass(frozen=True, eq=False)
class _State:
    """
    Where the fit stands.

    bell, residual : (w, n) float32, grey values
    weight : (w, n) float32, 1 / variance, 0 for unused pixels
    covariance : (6, n) of c0, c1, c2, in the order 00, 01, 02, 11, 12, 22
    step : (4, n), what Gauss and Newton would add to c
    """

    bell: Singles
    residual: Singles
    weight: Singles
    covariance: Floats
    step: Floats


class _Fit:
    """
    The same fit in many rows.

    c : (4, n), the polynomial and the background
    values, used : (w, n), as of the patches
    powers : (5, w), of x
    """

    def __init__(self, patches: Patches, noise: Noise) -> None:
        rough = patches.rough
        # rows side by side: what belongs to a row then applies to all its pixels at once
        self.values: Singles = np.ascontiguousarray(patches.values.T)
        self.used: Singles = np.ascontiguousarray(patches.used.T)
        self.powers: Singles = np.vander(patches.x, 5, increasing=True).T.astype(np.float32)
        self._noise = noise
        self._level = rough.level.astype(np.float64)
        share = np.maximum(_LEVEL_SHARE * rough.height, _LEVEL_SIGMA).astype(np.float64)
        self._level_weight = share**-2
        self._sigma = np.maximum(rough.width.astype(np.float64), 0.7)
        place = (rough.column - patches.column).astype(np.float64) + rough.middle
        curvature = -0.5 / self._sigma**2
        height = np.log(np.maximum(rough.height, 1.0))
        self.c: Floats = np.stack(
            [height + curvature * place**2, -2.0 * curvature * place, curvature, self._level]
        )

    def run(self, steps: int = _STEPS) -> _State:
        """Do a fixed number of steps; return the state that the last, small one started from."""
        for step in range(steps):
            state = self._evaluate(cautious=step < _CAUTIOUS)
            self._move(state.step)
        return state

    def _evaluate(self, *, cautious: bool) -> _State:
        c = self.c.astype(np.float32)
        bell = np.exp(self.powers[:3].T @ c[:3])
        above = self.values - c[3]
        light = np.maximum(bell, above) if cautious else bell
        weight = self.used / self._noise.variance(light + c[3], light)
        residual = above - bell
        return _State(bell, residual, weight, *self._solve(bell, weight, residual))

    def _solve(self, bell: Singles, weight: Singles, residual: Singles) -> tuple[Floats, Floats]:
        """Return covariance and step: the background is eliminated, the rest is 3 x 3."""
        powers = self.powers
        by_bell = weight * bell
        squares = (powers @ (by_bell * bell)).astype(np.float64)
        mixed = (powers[:3] @ by_bell).astype(np.float64)
        pull = (powers[:3] @ (by_bell * residual)).astype(np.float64)
        total = (powers[0] @ weight) + self._level_weight
        pull_level = powers[0] @ (weight * residual)
        pull_level = pull_level + self._level_weight * (self._level - self.c[3])
        share = mixed / total
        matrix = squares[symmetric.SUM] - mixed[symmetric.FIRST] * share[symmetric.SECOND]
        matrix[symmetric.DIAGONAL] += _RIDGE * (1.0 + matrix[symmetric.DIAGONAL])
        covariance = symmetric.inverse(matrix)
        step = symmetric.times(covariance, pull - share * pull_level)
        level_step = (pull_level - (mixed * step).sum(axis=0)) / total
        return covariance, np.concatenate([step, level_step[None]])

    def _move(self, step: Floats) -> None:
        reach = 2.0 * self._sigma
        size = np.abs(step[0]) + reach * (np.abs(step[1]) + reach * np.abs(step[2]))
        step[:3] *= np.minimum(1.0, _LARGEST / np.maximum(size, 1e-9))
        self.c += step
        bounds = -0.5 / (self._sigma / _STRETCH) ** 2, -0.5 / (self._sigma * _STRETCH) ** 2
        self.c[2] = np.minimum(np.maximum(self.c[2], bounds[0]), bounds[1])


def fit(patches: Patches, noise: Noise) -> Estimate:
    """Fit every patch, from its rough peak, by a fixed number of Gauss-Newton steps."""
    rows = _Fit(patches, noise)
    state = rows.run()
    c0, c1, c2, level = rows.c
    place, width = -0.5 * c1 / c2, np.sqrt(-0.5 / c2)
    height = np.exp(np.minimum(c0 - 0.25 * c1**2 / c2, 20.0))
    # the place is a function of c: its variance is g' C g
    sigma = symmetric.spread(state.covariance, np.stack([0.0 * c2, -0.5 / c2, 0.5 * c1 / c2**2]))
    skew, skew_sigma = _skew(rows, state, place, width)
    return Estimate(
        place=place,
        width=width,
        height=height,
        sigma=sigma,
        snr=signal_to_noise(height, width, level, noise),
        moved=patches.moved(place),
        misfit=_misfit(rows, state),
        skew=skew,
        skew_sigma=skew_sigma,
    )


def _skew(rows: _Fit, state: _State, place: Floats, width: Floats) -> tuple[Floats, Floats]:
    """
    Return how one-sided each stripe is, as a share of its height, and the 1 sigma of that.

    It is the amplitude of an odd cubic in the residuals, made blind to what a shift of the
    stripe would leave.
    """
    x = rows.powers[1][:, None]
    t = (x - place.astype(np.float32)) / width.astype(np.float32)
    square = t * t
    one = rows.powers[0]
    by_bell = state.weight * state.bell
    by_square = by_bell * state.bell * square
    # of a bell the ratio of the fourth to the second moment; weights make it another
    ratio = (one @ (by_square * square)) / np.maximum(one @ by_square, 1e-9)
    odd = t * (square - ratio)
    by_odd = by_bell * odd
    power = np.maximum(one @ (by_odd * odd * state.bell), 1e-9)
    skew = (one @ (by_odd * state.residual)) / power
    return skew.astype(np.float64), (power**-0.5).astype(np.float64)


def _misfit(rows: _Fit, state: _State) -> Floats:
    """Return by how much residuals exceed the noise for certain, 1 or more."""
    one = rows.powers[0]
    count = np.maximum(one @ rows.used - 4.0, 1.0)
    chi2 = (one @ (state.residual * state.residual * state.weight)) / count
    return np.asarray(np.sqrt(np.maximum(chi2 - 3.0 * np.sqrt(2.0 / count), 1.0)))


@dataclass(frozen=True, eq=False)
class Residuals:
    """
    What the fit leaves of pixels, (n,) each.

    total, laser : grey values that the fitted stripe gives, with and without its ground
    height : of the stripe, grey values; place : of the pixel, sigmas from the stripe's middle
    residual : grey values, enlarged by what the fit itself has taken off them
    """

    total: Floats
    laser: Floats
    height: Floats
    place: Floats
    residual: Floats


def residuals(patches: Patches, noise: Noise) -> Residuals:
    """Return the residuals of all pixels that tell something of the noise."""
    rows = _Fit(patches, noise)
    state = rows.run(_MANY_STEPS)
    bell, weight = state.bell.T.astype(np.float64), state.weight.T.astype(np.float64)
    powers = rows.powers[:3].T.astype(np.float64)
    slopes = np.concatenate([bell[..., None] * powers, np.ones((*bell.shape, 1))], axis=2)
    normal = np.einsum('nwi,nw,nwj->nij', slopes, weight, slopes)
    normal[:, [0, 1, 2, 3], [0, 1, 2, 3]] *= 1.0 + _RIDGE
    taken = weight * np.einsum('nwi,nij,nwj->nw', slopes, np.linalg.pinv(normal), slopes)
    told = (patches.used > 0) & (taken < _TAKEN)
    c0, c1, c2, level = rows.c[..., None]
    height = np.exp(np.minimum(c0 - 0.25 * c1**2 / c2, 20.0)) + 0.0 * bell
    return Residuals(
        total=(bell + level)[told],
        laser=bell[told],
        height=height[told],
        place=((patches.x + 0.5 * c1 / c2) * np.sqrt(-2.0 * c2))[told],
        residual=(state.residual.T[told] / np.sqrt(1.0 - taken[told])).astype(np.float64),
    )
