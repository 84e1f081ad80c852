# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Positions of the table from transforms (tf2_msgs/TFMessage), where a bag has no joint_states.

robot_state_publisher turns joint_states into transforms: the joint's position is the angle of the
rotation about z of the frame that turns. It is known modulo a turn, and without a velocity.
"""

from collections.abc import Iterator
import math
from types import SimpleNamespace
from typing import Any

from ivfmc_ros.errors import BagError

# Greatest x and y of the unit quaternion of a rotation about z: 0.1 degrees.
_MAX_TILT = 1e-3


def table_states(message: Any, frame: str, joint: str, where: str) -> Iterator[Any]:
    """
    Yield what a JointState would say of the table, for each transform of its frame.

    message : tf2_msgs/TFMessage
    frame : child frame that turns with the table
    joint : name that the states get
    where : file and topic, for the error
    :raises BagError: the frame does not turn about its z axis only, or its rotation is none
    """
    for transform in message.transforms:
        if transform.child_frame_id.lstrip('/') != frame:
            continue
        q = transform.transform.rotation
        norm = math.hypot(q.x, q.y, q.z, q.w)
        if not 0.5 < norm < 2.0 or math.hypot(q.x, q.y) > _MAX_TILT * norm:
            raise BagError(
                f'{where}: frame {frame!r} does not turn about z: its quaternion is '
                f'({q.x:g}, {q.y:g}, {q.z:g}, {q.w:g}); name the frame of the table by '
                '--table-frame'
            )
        yield SimpleNamespace(
            header=transform.header,
            name=[joint],
            position=[2.0 * math.atan2(q.z, q.w)],
            velocity=[],
        )


def child_frames(message: Any) -> set[str]:
    """Return the child frames of a tf2_msgs/TFMessage."""
    return {transform.child_frame_id.lstrip('/') for transform in message.transforms}
