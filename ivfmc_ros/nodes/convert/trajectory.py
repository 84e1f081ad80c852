# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The command of a move of the table."""

from builtin_interfaces.msg import Duration
from trajectory_msgs.msg import JointTrajectory
from trajectory_msgs.msg import JointTrajectoryPoint


def trajectory_to(joint: str, position: float, seconds: float) -> JointTrajectory:
    """
    Return the command that turns ``joint`` to ``position`` (radians) within ``seconds``.

    It ends at standstill. Its stamp is zero, which joint_trajectory_controller takes for now.
    """
    whole = int(seconds)
    point = JointTrajectoryPoint(
        positions=[position],
        velocities=[0.0],
        time_from_start=Duration(sec=whole, nanosec=int((seconds - whole) * 1e9)),
    )
    return JointTrajectory(joint_names=[joint], points=[point])
