# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Converts a geometry_msgs/PoseArray on ``view_poses`` to ``Poses``."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ivfmc_ros.cell import transforms
from ivfmc_ros.errors import MessageError
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Poses
from ivfmc_ros.model import View


def to_poses(message: Any, views: Sequence[View], where: str) -> Poses:
    """
    Return the pose of each view; element i of the message is that of view number i.

    where : file and topic, for the error
    :raises MessageError: a view has no pose, or an orientation is not a unit quaternion
    """
    poses = []
    for view in views:
        if view.number >= len(message.poses):
            raise MessageError(
                f'{where}: has {len(message.poses)} poses, none of view {view.number}'
            )
        poses.append(_matrix(message.poses[view.number], where))
    return Poses(turntable_from_view=np.array(poses).reshape(-1, 4, 4))


def _matrix(pose: Any, where: str) -> Floats:
    q, p = pose.orientation, pose.position
    quaternion_xyzw = np.array([q.x, q.y, q.z, q.w])
    # tolerance for senders that compute in single precision or round to text
    if not 0.99 < np.linalg.norm(quaternion_xyzw) < 1.01:
        raise MessageError(
            f'{where}: an orientation is not a unit quaternion: {quaternion_xyzw.tolist()}'
        )
    return transforms.rigid(Rotation.from_quat(quaternion_xyzw).as_matrix(), [p.x, p.y, p.z])
