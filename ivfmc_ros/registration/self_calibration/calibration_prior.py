# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Prior covariance of a cell's parameters, from the prior and the covariances of calibration."""

import numpy as np

from ivfmc_ros.model import Floats
from ivfmc_ros.registration.self_calibration.parameters import CellParameters


def prior_covariance(parameters: CellParameters) -> Floats:
    """
    Return (C, C), the sum of the prior's variances and the covariances of the calibration.

    The prior stands for changes since the calibration (a knock, a warm day), so that no cell errs
    by less; a cell with a poor calibration may err by more.
    """
    covariance = np.diag(parameters.sigma**2)
    index = {name: k for k, name in enumerate(parameters.names)}
    cell = parameters.cell
    if 'axis' in parameters.groups and cell.turntable.covariance is not None:
        J = _axis_jacobian(cell.turntable.camera_from_base, parameters.height)
        first = index['axis x']
        own = slice(first, first + len(J))
        covariance[own, own] += J @ cell.turntable.covariance @ J.T
    for laser in cell.lasers if 'lasers' in parameters.groups else ():
        if laser.covariance is not None:
            center, upright, across = parameters.plane_axes(laser)
            # rotating a plane by a small angle about an axis moves its normal by axis x normal
            turns = np.cross(laser.normal, np.eye(3)).T
            J = np.zeros((3, 4))
            J[0, :3], J[1, :3] = upright @ turns, across @ turns
            J[2, :3], J[2, 3] = center, 1.0
            first = index[f'{laser.name} yaw']
            own = slice(first, first + len(J))
            covariance[own, own] += J @ laser.covariance @ J.T
    return covariance


def cell_prior_factor(parameters: CellParameters) -> Floats:
    """Return L, (C, C), with the covariance L L'; rows of 0 for fixed parameters."""
    covariance = prior_covariance(parameters)
    # in units of each sigma, because radians and meters differ by orders of magnitude
    sigma = np.sqrt(np.diag(covariance))
    unit = np.where(sigma > 0, sigma, 1.0)
    eigenvalues, axes = np.linalg.eigh(covariance / np.outer(unit, unit))
    return np.asarray(sigma[:, None] * axes * np.sqrt(np.maximum(eigenvalues, 0.0)))


def _axis_jacobian(camera_from_base: Floats, height: float) -> Floats:
    """Return (4, 6), axis offsets and tilts by translation and rotation vector of the pose."""
    R = camera_from_base[:3, :3]
    x, y, z = R @ (0.0, 0.0, height)
    cross = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])  # rv x point
    J = np.zeros((4, 6))
    J[:2, :3], J[:2, 3:] = R.T[:2], (R.T @ cross)[:2]
    J[2:, 3:] = R.T[:2]
    return J
