# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Maximum a posteriori step of a degenerate least-squares problem.

Parameters are whitened by their prior; the eigenvectors of the information matrix are directions
about which the data are independent. Directions whose information does not clearly exceed the
prior's stay at the prior (solution remapping: Zhang, Kaess and Singh 2016, "On degeneracy of
optimization-based state estimation problems"). If they were solved, the noise of the residuals
would move them by many prior standard deviations, because correspondences follow the motion.
"""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.registration.solver.normal_equations import NormalEquations

# A direction is observable if the data's variance is at most the prior's divided by this. Chosen
# by the bench rows 'free directions moved' (cylinder, sphere, plate).
OBSERVABILITY_RATIO = 10.0
# Whitened variances are clipped here, for priors that are far wider than the data.
_MIN_VARIANCE = 1e-12
# A parameter counts as observed if its sigma is at most this share of the prior's.
_OBSERVED_SHARE = 0.5


@dataclass(frozen=True, eq=False, kw_only=True)
class Solution:
    """
    Parameters estimated from data and prior.

    values : (n,) in their units; the prior's mean is 0
    covariance : (n, n), posterior
    prior_sigma : (n,) prior standard deviations; 0 fixes a parameter
    directions : (k, m) whitened directions that were solved, orthonormal columns
    chi_square : of the solved values against the hypothesis that they are zero
    """

    values: Floats
    covariance: Floats
    prior_sigma: Floats
    directions: Floats
    chi_square: float

    @property
    def sigma(self) -> Floats:
        """(n,) posterior standard deviation in the parameters' units."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def observed(self) -> Bools:
        """(n,) parameters that the data determine clearly better than the prior."""
        return np.asarray(self.sigma < _OBSERVED_SHARE * self.prior_sigma)


def solve(
    equations: NormalEquations,
    current: Floats,
    prior_factor: Floats,
    directions: Floats | None = None,
) -> Solution:
    """
    Return the maximum a posteriori parameters; unobservable directions stay at the prior.

    current : (n,) the parameters at which the equations were linearized
    prior_factor : (n, k), a matrix L with the prior's covariance L L'
    directions : (k, m) whitened directions to solve for; None selects the observable ones
    """
    L = prior_factor
    hessian = L.T @ equations.hessian @ L
    V = _observable_directions(equations, L) if directions is None else directions
    rhs = L.T @ equations.gradient + hessian @ (np.linalg.pinv(L, rcond=1e-9) @ current)
    # rotated to where the errors of the data's solution are independent
    variance, axes = np.linalg.eigh(_data_covariance(equations, L, V))
    variance = np.maximum(variance, _MIN_VARIANCE)
    from_data = axes.T @ np.linalg.solve(V.T @ hessian @ V, V.T @ rhs)
    V, whitened = V @ axes, from_data / (1.0 + variance)
    posterior = np.eye(L.shape[1]) - V @ np.diag(1.0 / (1.0 + variance)) @ V.T
    return Solution(
        values=L @ (V @ whitened),
        covariance=L @ posterior @ L.T,
        prior_sigma=np.linalg.norm(L, axis=1),
        directions=V,
        chi_square=float((from_data * whitened / variance).sum()),
    )


def _observable_directions(equations: NormalEquations, L: Floats) -> Floats:
    """Return (n, m) whitened directions that the data determine clearly better than the prior."""
    eigenvalues, V = np.linalg.eigh(L.T @ equations.information @ L)
    V = V[:, eigenvalues > OBSERVABILITY_RATIO]
    # correlated errors make the data's variance larger than the information matrix claims
    variance, axes = np.linalg.eigh(_data_covariance(equations, L, V))
    return np.asarray(V @ axes[:, variance < 1.0 / OBSERVABILITY_RATIO])


def _data_covariance(equations: NormalEquations, L: Floats, V: Floats) -> Floats:
    """Return (m, m), the covariance of the data's own solution along whitened ``V`` (n, m)."""
    if not V.shape[1]:
        return np.zeros((0, 0))
    white = L @ V
    information, claimed, found = (
        white.T @ matrix @ white
        for matrix in (equations.information, equations.hessian, equations.gradient_covariance)
    )
    # at least the covariance of independent noise: a small sample may scatter less by chance
    half = np.linalg.cholesky(claimed + 1e-9 * np.trace(claimed) * np.eye(len(claimed)))
    ratio, axes = np.linalg.eigh(np.linalg.solve(half, np.linalg.solve(half, found).T))
    root = np.linalg.solve(information, half @ axes * np.sqrt(np.maximum(ratio, 1.0)))
    return np.asarray(root @ root.T)
