# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.synthetic import small_cell

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.registration.self_calibration.calibration_prior import cell_prior_factor
from ivfmc_ros.registration.self_calibration.calibration_prior import prior_covariance
from ivfmc_ros.registration.self_calibration.parameters import CellParameters
from ivfmc_ros.registration.solver.prior import CellPrior

CELL = small_cell()
NONE = CellPrior(axis_offset=0.0, axis_tilt=0.0, laser_tilt=0.0, laser_offset=0.0, angle=0.0)


def parameters(cell: Cell, prior: CellPrior = NONE) -> CellParameters:
    groups = frozenset({'axis', 'lasers'})
    return CellParameters(cell=cell, groups=groups, height=0.03, prior=prior)


def test_without_covariances_the_prior_is_all():
    known = parameters(CELL, CellPrior())
    np.testing.assert_allclose(prior_covariance(known), np.diag(known.sigma**2))


def test_pose_covariance_becomes_offsets_and_tilts_of_the_axis():
    T = CELL.turntable.camera_from_base
    shift, turn = np.array([1e-4, -5e-5, 2e-4]), np.array([3e-4, 2e-4, -1e-4])
    moved = transforms.rigid(Rotation.from_rotvec(turn).as_matrix() @ T[:3, :3], T[:3, 3] + shift)
    error = np.concatenate([shift, turn])
    cell = replace(CELL, turntable=replace(CELL.turntable, covariance=np.outer(error, error)))
    factor = cell_prior_factor(parameters(cell))
    values = factor[:, np.argmax(np.abs(factor).sum(axis=0))]
    # the same axis, except for rotation about it, translation along it, and the sign
    assert min(axis_off(values, moved), axis_off(-values, moved)) < 1e-6
    assert axis_off(0.0 * values, moved) > 1e-5


def axis_off(values, pose):
    """By how much the axis of a corrected cell differs from that of a pose."""
    corrected = parameters(CELL).corrected(values).turntable.camera_from_base
    return np.abs((transforms.invert(corrected) @ pose)[:2, 2:]).max()


def test_plane_covariance_becomes_yaw_roll_and_offset():
    laser = CELL.lasers[0]
    true = parameters(CELL)._plane(laser, 2e-4, -3e-4, 1e-5)
    error = np.append(true.normal - laser.normal, true.offset - laser.offset)
    calibrated = replace(laser, covariance=np.outer(error, error))
    covariance = prior_covariance(parameters(replace(CELL, lasers=(calibrated, CELL.lasers[1]))))
    sigma = np.sqrt(np.diag(covariance))
    assert sigma[4:7] == pytest.approx([2e-4, 3e-4, 1e-5], rel=1e-2)
    assert covariance[4, 5] < 0
    np.testing.assert_array_equal(sigma[7:], 0.0)
