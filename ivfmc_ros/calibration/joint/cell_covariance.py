# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Covariance of the parameters of ``cell.yaml`` from that of the joint adjustment."""

import numpy as np

from ivfmc_ros.calibration.joint.adjustment import JointAdjustment
from ivfmc_ros.calibration.joint.parameters import JointState
from ivfmc_ros.calibration.joint.parameters import ParameterOrder
from ivfmc_ros.calibration.joint.parameters import plane_tangent
from ivfmc_ros.cell.covariance import CellCovariance
from ivfmc_ros.cell.covariance import parameter_names
from ivfmc_ros.model import Floats


def cell_covariance(adjusted: JointAdjustment, scale_u: float | None = None) -> CellCovariance:
    """
    Return the covariance of intrinsics, planes and axis.

    scale_u : relative standard uncertainty of the length of the board; None if it is not known
    """
    state = adjusted.state
    J = _to_cell_parameters(state, adjusted.order)
    matrix = J @ adjusted.covariance @ J.T
    return CellCovariance(
        parameters=parameter_names(state.camera, adjusted.order.laser_names),
        matrix=0.5 * (matrix + matrix.T),
        scale_u=scale_u,
    )


def _to_cell_parameters(state: JointState, order: ParameterOrder) -> Floats:
    """Return (p, count): derivative of the parameters of a cell by those of the adjustment."""
    intrinsics, lasers = order.intrinsic_count, len(state.lasers)
    J = np.zeros((intrinsics + 4 * lasers + 6, order.count))
    J[:intrinsics, order.intrinsics] = np.eye(intrinsics)
    for index, laser in enumerate(state.lasers):
        row, column = intrinsics + 4 * index, order.laser(index).start
        J[row : row + 3, column : column + 2] = plane_tangent(laser.normal)
        J[row + 3, column + 2] = 1.0
    R, first = state.axis.camera_from_base[:3, :3], order.axis.start
    # the base moves in its own axes, the cell's pose in those of the camera
    J[-6:-3, first + 2 : first + 5] = R
    J[-3:, first : first + 2] = R[:, :2]
    return J
