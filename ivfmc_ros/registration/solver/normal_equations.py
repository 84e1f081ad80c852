# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Normal equations of all correspondences in the view poses and the cell's parameters."""

from collections.abc import Callable
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.registration.solver.correspondences import Correspondences

# Parameters of a pose: rotation vector (radians) about the frame's origin, translation (meters).
DOF = 6

# Edge of the cubes, in surfel spacings, in which correspondences share neighboring points: their
# errors are summed before they are squared.
_CLUSTER = 5.0
# Edge of the cubes, in surfel spacings, in which the systematic error is one and the same.
_REGION = 20.0
# Residuals up to so many sigmas are not treated as outliers.
_OUTLIER_SIGMAS = 2.5

# (view, (n, 3) points, (n,) index of the surfel near each) -> (n, C, 3) meters per parameter
JacobianAt = Callable[[int, Floats, Ints], Floats]


@dataclass(frozen=True, eq=False, kw_only=True)
class CellJacobian:
    """
    Derivative of the points of every view by the C parameters of the cell.

    at_surfels : for each view, (n, C, 3) meters per unit of a parameter
    at : the same at any points of the surface. Both views of a correspondence are evaluated at
        their common midpoint: between two surfels, even a millimeter apart, the table angle
        differs, which would look like information about the angle
    """

    at_surfels: Sequence[Floats]
    at: JacobianAt

    @property
    def parameter_count(self) -> int:
        """C, the number of parameters of the cell."""
        return self.at_surfels[0].shape[1] if self.at_surfels else 0


@dataclass(frozen=True, kw_only=True)
class ResidualNoise:
    """
    Noise model of the residuals.

    scale : factor by which residuals exceed their claimed sigmas
    outlier_width : meters; a residual beyond it, and beyond the noise, is an outlier
    correlated_fraction : systematic error of whole regions, as a share of a surfel's sigma
    """

    scale: float
    outlier_width: float
    correlated_fraction: float


@dataclass(frozen=True, eq=False, kw_only=True)
class NormalEquations:
    """
    Normal equations in ``n = 6 views + C`` parameters.

    The noise of normals adds apparent information about every motion. The normals of the two
    surfels of a correspondence err independently, so that their product is free of this bias.

    information : (n, n) J_a' W J_b, with the normals of one side times those of the other
    hessian : (n, n) J' W J with the bisector of the normals, the Gauss-Newton Hessian
    gradient : (n,) - J' W r
    gradient_covariance : (n, n) empirical, from clusters of correspondences with common errors
        and from the systematic errors of regions
    """

    information: Floats
    hessian: Floats
    gradient: Floats
    gradient_covariance: Floats


def robust_scale(blocks: Sequence[Correspondences]) -> float:
    """Return the robust standard deviation (1.4826 MAD) of residual over sigma; 1 for no data."""
    ratios = [np.abs(block.residuals) / block.sigma for block in blocks if len(block)]
    return max(1.4826 * float(np.median(np.concatenate(ratios))), 1e-3) if ratios else 1.0


def build_normal_equations(
    blocks: Sequence[Correspondences],
    jacobian: CellJacobian | None,
    views: int,
    noise: ResidualNoise,
    spacing: float | None,
) -> NormalEquations:
    """
    Sum the normal equations of all correspondences.

    jacobian : of the cell's parameters; None if the cell is fixed
    spacing : meters, between surfels; None while the residuals are still dominated by the error
        to be corrected, so that the gradient's covariance cannot be estimated from them
    """
    size = DOF * views + (jacobian.parameter_count if jacobian else 0)
    total = [np.zeros((size, size)) for _ in range(3)]
    gradient = np.zeros(size)
    for block in blocks:
        if not len(block):
            continue
        columns = _columns(block, size, views)
        square = np.ix_(columns, columns)
        part = _of_block(block, jacobian, noise, spacing)
        matrices = (part.information, part.hessian, part.gradient_covariance)
        for sums, one in zip(total, matrices, strict=True):
            sums[square] += one
        gradient[columns] += part.gradient
    return NormalEquations(
        information=total[0], hessian=total[1], gradient=gradient, gradient_covariance=total[2]
    )


def _of_block(
    block: Correspondences,
    jacobian: CellJacobian | None,
    noise: ResidualNoise,
    spacing: float | None,
) -> NormalEquations:
    """Return the normal equations of the correspondences of two views, in 12 + C parameters."""
    weight = robust_weight(block, noise)[:, None]
    relative = _relative_jacobian(block, jacobian)
    J_a = residual_jacobian(block, block.normals_a, relative)
    J_b = residual_jacobian(block, block.normals_b, relative)
    J = (J_a + J_b) * (0.5 * np.sqrt(weight))
    cross = (J_a * weight).T @ J_b
    gradients = -J * (block.residuals[:, None] * np.sqrt(weight))
    hessian = J.T @ J
    return NormalEquations(
        information=(cross + cross.T) / 2,
        hessian=hessian,
        gradient=gradients.sum(axis=0),
        gradient_covariance=hessian
        if spacing is None
        else _gradient_covariance(block, gradients, J, weight, spacing, noise.correlated_fraction),
    )


def _gradient_covariance(
    block: Correspondences,
    gradients: Floats,
    J: Floats,
    weight: Floats,
    spacing: float,
    correlated_fraction: float,
) -> Floats:
    clusters = _cluster_sums(gradients, block.midpoint, _CLUSTER * spacing)
    systematic = J * (correlated_fraction * block.sigma[:, None] * np.sqrt(weight))
    regions = _cluster_sums(systematic, block.midpoint, _REGION * spacing)
    return np.asarray(clusters.T @ clusters + regions.T @ regions)


def robust_weight(block: Correspondences, noise: ResidualNoise) -> Floats:
    """Return (n,) weights in 1/meter^2 (Geman and McClure 1987)."""
    spread = block.sigma * max(noise.scale, 1.0)
    limit = np.maximum(_OUTLIER_SIGMAS * block.sigma * noise.scale, noise.outlier_width)
    ratio = block.residuals / limit
    return np.asarray(1.0 / (spread**2 * (1.0 + ratio**2) ** 2))


def residual_jacobian(block: Correspondences, normals: Floats, relative: Floats | None) -> Floats:
    """
    Return (n, 12 + C), the derivative of residuals by the poses of a and b, and by the cell.

    relative : (n, C, 3) meters per parameter of the cell by which a's point moves more than b's
    """
    pose = np.hstack([np.cross(block.midpoint, normals), normals])
    if relative is None:
        return np.hstack([pose, -pose])
    return np.hstack([pose, -pose, np.einsum('ncd,nd->nc', relative, normals)])


def _relative_jacobian(block: Correspondences, jacobian: CellJacobian | None) -> Floats | None:
    if jacobian is None or not jacobian.parameter_count:
        return None
    of_a = jacobian.at(block.a, block.midpoint, block.index_a)
    return np.asarray(of_a - jacobian.at(block.b, block.midpoint, block.index_b))


def _columns(block: Correspondences, size: int, views: int) -> Ints:
    a, b = DOF * block.a, DOF * block.b
    return np.concatenate(
        [np.arange(a, a + DOF), np.arange(b, b + DOF), np.arange(DOF * views, size)]
    )


def _cluster_sums(values: Floats, points_xyz: Floats, edge: float) -> Floats:
    """Return the sums of (n, m) values over cubes of ``edge`` meters."""
    cube = np.floor((points_xyz - points_xyz.min(axis=0)) / edge).astype(np.int64)
    shape = cube.max(axis=0) + 1
    key = (cube[:, 0] * shape[1] + cube[:, 1]) * shape[2] + cube[:, 2]
    order = np.argsort(key, kind='stable')
    starts = np.flatnonzero(np.diff(key[order], prepend=-1))
    return np.asarray(np.add.reduceat(values[order], starts, axis=0))
