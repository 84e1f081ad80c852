# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Kinematics of one axis: trajectories, controller units, position between two reports."""

from ivfmc_ros.devices.motion.axis_units import AxisUnits as AxisUnits
from ivfmc_ros.devices.motion.position_estimator import PositionEstimator as PositionEstimator
from ivfmc_ros.devices.motion.trajectory import Segment as Segment
from ivfmc_ros.devices.motion.trajectory import Trajectory as Trajectory
