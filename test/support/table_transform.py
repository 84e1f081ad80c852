# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Transforms of a turntable, as tf publishes them."""

import math

from ivfmc_ros.storage.messages import cdr
from ivfmc_ros.storage.messages.sensor_messages import TF_MESSAGE


def transform(stamp_ns, frame, angle, tilt=0.0):
    """Return the transform of a frame that has turned by an angle about z, rad."""
    half = angle / 2
    rotation = cdr.message(
        'geometry_msgs/msg/Quaternion', x=tilt, y=0.0, z=math.sin(half), w=math.cos(half)
    )
    translation = cdr.message('geometry_msgs/msg/Vector3', x=0.0, y=0.0, z=0.0)
    moved = cdr.message('geometry_msgs/msg/Transform', translation=translation, rotation=rotation)
    return cdr.message(
        'geometry_msgs/msg/TransformStamped',
        header=cdr.header(stamp_ns, 'turntable_base'),
        child_frame_id=frame,
        transform=moved,
    )


def transforms(stamp_ns, angle):
    """Return a message of tf with the table's frame."""
    return cdr.message(TF_MESSAGE, transforms=[transform(stamp_ns, 'turntable', angle)])
