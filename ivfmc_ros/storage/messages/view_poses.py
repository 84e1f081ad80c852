# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The poses of views out of a geometry_msgs/PoseArray, from the graph or from a bag."""

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
    Return the pose of each of the views: that of view number i stands at place i.

    where : the topic, for the error
    :raises MessageError: a view has none, or a rotation is none
    """
    found = []
    for view in views:
        if view.number >= len(message.poses):
            raise MessageError(
                f'{where}: has {len(message.poses)} poses, none of view {view.number}'
            )
        found.append(_matrix(message.poses[view.number], where))
    return Poses(turntable_from_view=np.array(found).reshape(-1, 4, 4))


def _matrix(pose: Any, where: str) -> Floats:
    q, p = pose.orientation, pose.position
    numbers = np.array([q.x, q.y, q.z, q.w])
    if not 0.99 < np.linalg.norm(numbers) < 1.01:
        raise MessageError(f'{where}: an orientation is no unit quaternion: {numbers.tolist()}')
    return transforms.rigid(Rotation.from_quat(numbers).as_matrix(), [p.x, p.y, p.z])
