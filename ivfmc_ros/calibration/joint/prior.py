# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is known of the target on the platter before the adjustment: its lengths and flatness."""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.calibration.boards.markers import Markers
from ivfmc_ros.calibration.joint.parameters import apply_step
from ivfmc_ros.calibration.joint.parameters import JointState
from ivfmc_ros.calibration.joint.parameters import ParameterOrder
from ivfmc_ros.calibration.turntable.observations import Target
from ivfmc_ros.model import Floats

# Standard deviation of the length of a board on the platter over that of the board that gives the
# scale: two prints of one printer agree within 0.05 %.
_BOARD_SCALE_STD = 5e-4
# Of the side of single markers: 1 %, because blur and the response of the camera change the size
# of a dark square by as much (measured: 0.4 to 2 %).
_MARKER_SCALE_STD = 1e-2
# Standard deviation in meters of a marker corner's height above the platter: paper curls.
_CORNER_HEIGHT_STD = 3e-4
_STEP = 1e-6  # meters and without unit, of the numerical derivative


@dataclass(frozen=True)
class Prior:
    """Prior of the target on the platter."""

    target: Target

    @property
    def length_std(self) -> float:
        """Relative standard deviation of the length of the target."""
        return _MARKER_SCALE_STD if isinstance(self.target, Markers) else _BOARD_SCALE_STD

    def residuals(self, state: JointState) -> Floats:
        """Return (k,) prior minus present values, in standard deviations."""
        axis = state.axis
        if isinstance(self.target, Markers) and axis.free_corners:
            scale = (1.0 - axis.mean_side() / self.target.side) / _MARKER_SCALE_STD
            return np.append(-axis.layout[:, 2] / _CORNER_HEIGHT_STD, scale)
        return np.array([(1.0 - axis.scale) / _BOARD_SCALE_STD])

    def cost(self, state: JointState) -> float:
        """Return the sum of squares."""
        return float((self.residuals(state) ** 2).sum())

    def equations(
        self, state: JointState, order: ParameterOrder, expansion: Floats
    ) -> tuple[Floats, Floats]:
        """Return the (c, c) matrix and (c,) gradient of the free parameters."""
        values = self.residuals(state)
        jacobian = np.zeros((len(values), order.count))
        poses, angles = np.zeros_like(state.board_poses), np.zeros_like(state.axis.angles)
        for column in range(order.axis.start, order.axis.stop):
            step = np.zeros(order.count)
            step[column] = _STEP
            moved = apply_step(state, order, step, poses, angles)
            jacobian[:, column] = (values - self.residuals(moved)) / _STEP
        free = jacobian @ expansion
        return free.T @ free, free.T @ values
