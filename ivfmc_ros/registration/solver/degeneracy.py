# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Solve only what the data see.

Unknowns are whitened by their prior; the eigenvectors of the data's information are directions
that the data see independently of each other. Those whose information does not clearly exceed
the prior's stay at the prior (solution remapping, Zhang and Singh 2016, "On degeneracy of
optimization-based state estimation problems"): the residuals' noise would move them by many
prior sigmas, because correspondences shrink with the scene.
"""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.registration.solver.normal_equations import System

# A direction is solved where its data are known this many times better than by the prior, in
# variance.
CLEARLY = 10.0
# Whitened variances below this are none: some priors are no priors.
_LEAST_VARIANCE = 1e-12
# An unknown counts as observed where its sigma is at most this share of the prior's.
_OBSERVED = 0.5


@dataclass(frozen=True, eq=False, kw_only=True)
class Solution:
    """
    Unknowns as the data and the prior have them together.

    values : (n,) in their units; the prior's mean is 0
    covariance : (n, n), of data and prior together
    prior_sigma : (n,) in their units; 0 is a prior that allows nothing
    directions : (k, m) whitened directions that were solved, orthonormal columns
    surprise : chi-square of the solved values against data that found nothing
    """

    values: Floats
    covariance: Floats
    prior_sigma: Floats
    directions: Floats
    surprise: float

    @property
    def sigma(self) -> Floats:
        """(n,) 1 sigma in the unknowns' units."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def observed(self) -> Bools:
        """(n,) what the data know clearly better than the prior."""
        return np.asarray(self.sigma < _OBSERVED * self.prior_sigma)


def solve(
    system: System, current: Floats, prior_root: Floats, directions: Floats | None = None
) -> Solution:
    """
    Return the most probable unknowns, with the directions that are not seen at the prior.

    current : (n,) the unknowns at which the system was linearised
    prior_root : (n, k), a matrix L with the prior's covariance L L'
    directions : (k, m) solve these whitened ones, whatever the data see
    """
    L = prior_root
    curvature = L.T @ system.curvature @ L
    V = _seen(system, L) if directions is None else directions
    pull = L.T @ system.gradient + curvature @ (np.linalg.pinv(L, rcond=1e-9) @ current)
    # rotated to where what the data find errs independently
    variance, axes = np.linalg.eigh(_spread(system, L, V))
    variance = np.maximum(variance, _LEAST_VARIANCE)
    found = axes.T @ np.linalg.solve(V.T @ curvature @ V, V.T @ pull)
    V, along = V @ axes, found / (1.0 + variance)
    posterior = np.eye(L.shape[1]) - V @ np.diag(1.0 / (1.0 + variance)) @ V.T
    return Solution(
        values=L @ (V @ along),
        covariance=L @ posterior @ L.T,
        prior_sigma=np.linalg.norm(L, axis=1),
        directions=V,
        surprise=float((found * along / variance).sum()),
    )


def _seen(system: System, L: Floats) -> Floats:
    """Return the (n, m) whitened directions that the data know clearly better than the prior."""
    level, V = np.linalg.eigh(L.T @ system.information @ L)
    V = V[:, level > CLEARLY]
    # what errs together may leave less than the number of pairs promises
    variance, axes = np.linalg.eigh(_spread(system, L, V))
    return np.asarray(V @ axes[:, variance < 1.0 / CLEARLY])


def _spread(system: System, L: Floats, V: Floats) -> Floats:
    """Return the covariance (m, m) of what the data alone find along directions ``V`` (n, m)."""
    if not V.shape[1]:
        return np.zeros((0, 0))
    white = L @ V
    inner, claimed, found = (
        white.T @ matrix @ white
        for matrix in (system.information, system.curvature, system.scatter)
    )
    # at least what independent noise makes: a lucky sample is no precision
    half = np.linalg.cholesky(claimed + 1e-9 * np.trace(claimed) * np.eye(len(claimed)))
    ratio, axes = np.linalg.eigh(np.linalg.solve(half, np.linalg.solve(half, found).T))
    root = np.linalg.solve(inner, half @ axes * np.sqrt(np.maximum(ratio, 1.0)))
    return np.asarray(root @ root.T)
