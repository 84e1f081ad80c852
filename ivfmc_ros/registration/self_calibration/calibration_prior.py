# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a cell's own calibration says about how wrong it may be, in the unknowns of a cell."""

import numpy as np

from ivfmc_ros.model import Floats
from ivfmc_ros.registration.self_calibration.parameters import CellUnknowns


def prior_covariance(unknowns: CellUnknowns) -> Floats:
    """
    Return (C, C): the sigmas of the prior, and on top of them the covariances of the calibration.

    The prior stands for what happened since: a cell whose calibration was poor may err by more,
    and none by less than what a knock or a warm day makes.
    """
    covariance = np.diag(unknowns.sigma**2)
    index = {name: k for k, name in enumerate(unknowns.names)}
    cell = unknowns.cell
    if 'axis' in unknowns.groups and cell.turntable.covariance is not None:
        J = _axis_slopes(cell.turntable.camera_from_base, unknowns.height)
        first = index['axis x']
        own = slice(first, first + len(J))
        covariance[own, own] += J @ cell.turntable.covariance @ J.T
    for laser in cell.lasers if 'lasers' in unknowns.groups else ():
        if laser.covariance is not None:
            centre, upright, across = unknowns.frame_of(laser)
            # a turned plane's normal goes towards what is across the axis of the turn
            turns = np.cross(laser.normal, np.eye(3)).T
            J = np.zeros((3, 4))
            J[0, :3], J[1, :3] = upright @ turns, across @ turns
            J[2, :3], J[2, 3] = centre, 1.0
            first = index[f'{laser.name} yaw']
            own = slice(first, first + len(J))
            covariance[own, own] += J @ laser.covariance @ J.T
    return covariance


def prior_root(unknowns: CellUnknowns) -> Floats:
    """Return (C, C), a matrix L with the covariance L L'; rows of 0 for what may not move."""
    covariance = prior_covariance(unknowns)
    # in units of each sigma: radians and metres differ by orders of magnitude
    sigma = np.sqrt(np.diag(covariance))
    unit = np.where(sigma > 0, sigma, 1.0)
    level, axes = np.linalg.eigh(covariance / np.outer(unit, unit))
    return np.asarray(sigma[:, None] * axes * np.sqrt(np.maximum(level, 0.0)))


def _axis_slopes(camera_from_base: Floats, height: float) -> Floats:
    """Return (4, 6): offsets and tilts of the axis by translation and rotation vector."""
    R = camera_from_base[:3, :3]
    x, y, z = R @ (0.0, 0.0, height)
    cross = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])  # rv x point
    J = np.zeros((4, 6))
    J[:2, :3], J[:2, 3:] = R.T[:2], (R.T @ cross)[:2]
    J[2:, 3:] = R.T[:2]
    return J
