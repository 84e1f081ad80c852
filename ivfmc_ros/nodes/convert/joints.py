# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of joints: states of table and lasers, and commands to the table."""

from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from ivfmc_ros.errors import ParameterError

# Greatest position that is commanded, radians (1000 turns): numbers beyond are no position, and a
# controller computes in single precision, which has 0.0005 rad there.
_MAX_POSITION = 6283.2


def read_trajectory(message: JointTrajectory, joint: str) -> tuple[float, float]:
    """
    Return position (radians) and duration (seconds, 0: as fast as allowed) of a command.

    :raises ParameterError: it is for another joint, or not a single point with velocity 0
    """
    if list(message.joint_names) != [joint]:
        raise ParameterError(
            f'joint_trajectory: is for joints {list(message.joint_names)}, not for {joint}'
        )
    if len(message.points) != 1:
        raise ParameterError(f'joint_trajectory: has {len(message.points)} points, not 1')
    point = message.points[0]
    if len(point.positions) != 1:
        raise ParameterError(f'joint_trajectory: has {len(point.positions)} positions, not 1')
    if any(velocity != 0.0 for velocity in point.velocities):
        raise ParameterError('joint_trajectory: the final velocity must be 0')
    position, start = float(point.positions[0]), point.time_from_start
    # written so that NaN is refused, too
    if not abs(position) <= _MAX_POSITION:
        raise ParameterError(
            f'joint_trajectory: the position {position} rad is not finite, or beyond '
            f'{_MAX_POSITION:g} rad'
        )
    seconds = start.sec + start.nanosec * 1e-9
    if seconds < 0.0:
        raise ParameterError(f'joint_trajectory: time_from_start is negative, {seconds} s')
    return position, seconds


def joint_state(
    stamp_ns: int,
    names: list[str],
    positions: list[float],
    velocities: list[float] | None = None,
) -> JointState:
    """Return a JointState of joints (radians, rad/s) or of lasers (1.0 on, 0.0 off)."""
    message = JointState(name=names, position=positions, velocity=velocities or [])
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 1_000_000_000)
    return message
