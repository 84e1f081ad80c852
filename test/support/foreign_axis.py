# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Stand-in for joint_trajectory_controller and joint_state_broadcaster of ros2_controllers 4.

What is accepted, how a trajectory of one point is interpolated, and the contents of the messages
are those of the sources for Jazzy (4.42.1). The axis follows its command exactly; its encoder has
counts, and no velocity interface.
"""

from itertools import pairwise
import math

import numpy as np
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from ivfmc_ros.devices.motion.trajectory import Segment
from ivfmc_ros.devices.motion.trajectory import Trajectory
from ivfmc_ros.nodes.convert.stamps import header

JOINT = 'turntable_joint'
# Other joints of the same controller manager, in the order in which the broadcaster names them.
JOINTS = ('lift_joint', JOINT, 'gripper_joint')
# Counts of a turn of a 17-bit encoder.
COUNTS = 2**17
# Pieces of constant acceleration of a spline; half a turn is off by 1e-6 rad then.
_PIECES = 100


class ForeignAxis:
    """
    Accepts trajectories as joint_trajectory_controller, and reports as joint_state_broadcaster.

    refused : why each trajectory that was not accepted was refused
    """

    def __init__(self, seed: int = 1) -> None:
        """``seed`` : of the encoder, which is between two counts."""
        # start and target: second, position (rad), velocity (rad/s)
        self._start, self._target = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        self.refused: list[str] = []
        self._rng = np.random.default_rng(seed)

    def position_at(self, second: float) -> float:
        """Return the true position, rad."""
        return self._state_at(second)[0]

    def _state_at(self, second: float) -> tuple[float, float]:
        """Cubic spline from the state at the command to the point, as for one with velocities."""
        (begin, p, v), (end, q, _) = self._start, self._target
        if second >= end:
            return q, 0.0
        T, t = end - begin, max(second - begin, 0.0)
        c2 = (3.0 * (q - p) - 2.0 * v * T) / T**2
        c3 = (2.0 * (p - q) + v * T) / T**3
        return p + (v + (c2 + c3 * t) * t) * t, v + (2.0 * c2 + 3.0 * c3 * t) * t

    def command(self, message: JointTrajectory, now_s: float) -> None:
        """Take a trajectory, or note why it is refused."""
        reason = refusal(message, int(now_s * 1e9))
        if reason:
            self.refused.append(reason)
            return
        index = list(message.joint_names).index(JOINT)
        point = message.points[-1]
        seconds = point.time_from_start.sec + point.time_from_start.nanosec * 1e-9
        self._start = (now_s, *self._state_at(now_s))
        self._target = now_s + seconds, point.positions[index], 0.0

    def trajectory(self) -> Trajectory:
        """Return the motion since the last command, the spline in pieces; rad and seconds."""
        begin, end = self._start[0], self._target[0]
        times = np.linspace(begin, end, _PIECES + 1).tolist()
        states = [self._state_at(second) for second in times]
        pieces = [
            Segment(time=t, position=p, velocity=v, acceleration=(w - v) / (u - t))
            for (t, u), ((p, v), (_, w)) in zip(pairwise(times), pairwise(states), strict=True)
            if u > t
        ]
        return (*pieces, Segment(time=end, position=self._target[1]))

    def joint_states(self, now_s: float) -> JointState:
        """Return the message of one update: stamped by it, the hardware was read just before."""
        count = 2.0 * math.pi / COUNTS
        noise = int(self._rng.integers(0, 2))
        position = (math.floor(self.position_at(now_s) / count) + noise) * count
        # the gripper has no position interface: NaN, as all that the hardware does not tell
        unknown = [math.nan] * len(JOINTS)
        return JointState(
            header=header(int(now_s * 1e9), ''),
            name=list(JOINTS),
            position=[0.25, position, math.nan],
            velocity=unknown,
            effort=unknown,
        )


def refusal(message: JointTrajectory, now_ns: int) -> str:
    """
    Return why the controller does not accept a trajectory, '' if it does.

    Its joints are those of the table and the lift; allow_partial_joints_goal is true.
    """
    names, points = list(message.joint_names), list(message.points)
    begin_ns = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
    times = [p.time_from_start.sec * 1_000_000_000 + p.time_from_start.nanosec for p in points]
    counts = {len(p.positions) for p in points} | {len(p.velocities) or len(names) for p in points}
    last = points[-1].velocities if points else []
    eps = np.finfo(np.float32).eps
    faults = {
        'joints are not those of the controller': not names or not set(names) <= set(JOINTS[:2]),
        'the trajectory is empty': not points,
        'velocity of the last point is not zero': any(abs(v) > eps for v in last),
        # a stamp of zero means now
        'the trajectory ends in the past': bool(begin_ns) and begin_ns + max(times) < now_ns,
        'a point has another number of positions or velocities than joints': counts
        != {len(names)},
        'effort is not commanded': any(len(point.effort) for point in points),
        'times are not ascending': times != sorted(set(times)),
    }
    return next((text for text, is_wrong in faults.items() if is_wrong), '')
