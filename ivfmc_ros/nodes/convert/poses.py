# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""View poses to geometry_msgs/PoseArray."""

from collections.abc import Mapping
from collections.abc import Sequence

from geometry_msgs.msg import Point
from geometry_msgs.msg import Pose
from geometry_msgs.msg import PoseArray
from geometry_msgs.msg import Quaternion
import numpy as np
from scipy.spatial.transform import Rotation

from ivfmc_ros.model import Floats
from ivfmc_ros.model import Poses
from ivfmc_ros.model import View
from ivfmc_ros.nodes.convert.clouds import FRAME
from ivfmc_ros.nodes.convert.stamps import header


def from_poses(views: Sequence[View], poses: Poses, stamp_ns: int) -> PoseArray:
    """Return the message whose pose i is that of view number i, identity for missing numbers."""
    registered = zip(views, poses.turntable_from_view, strict=True)
    return from_transforms({view.number: T for view, T in registered}, stamp_ns)


def from_transforms(by_number: Mapping[int, Floats], stamp_ns: int) -> PoseArray:
    """
    Return the message whose pose i is the transform of view number i.

    by_number : (4, 4) turntable_from_view, meters; identity for missing numbers
    """
    count = max(by_number, default=-1) + 1
    poses = [_pose(by_number.get(number, np.eye(4))) for number in range(count)]
    return PoseArray(header=header(stamp_ns, FRAME), poses=poses)


def _pose(T: Floats) -> Pose:
    x, y, z, w = Rotation.from_matrix(T[:3, :3]).as_quat()
    position = Point(x=float(T[0, 3]), y=float(T[1, 3]), z=float(T[2, 3]))
    rotation = Quaternion(x=float(x), y=float(y), z=float(z), w=float(w))
    return Pose(position=position, orientation=rotation)
