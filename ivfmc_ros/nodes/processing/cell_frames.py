# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
``robot_description``, ``/tf_static`` and ``/tf`` of a cell, all from ``cell.yaml``.

tf2_msgs is not among the packages that this one needs: without it there are no transforms, which
the diagnostics say.
"""

import importlib
from typing import Any

from geometry_msgs.msg import Quaternion
from geometry_msgs.msg import Transform
from geometry_msgs.msg import TransformStamped
from geometry_msgs.msg import Vector3
import numpy as np
from scipy.spatial.transform import Rotation
from std_msgs.msg import String

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell_file import CellDraft
from ivfmc_ros.cell.urdf import BASE
from ivfmc_ros.cell.urdf import TABLE
from ivfmc_ros.cell.urdf import urdf
from ivfmc_ros.model import Floats
from ivfmc_ros.nodes.convert.stamps import header
from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.nodes.processing.cell_source import CellSource

# Topics of tf2, the same in every namespace.
TF, TF_STATIC = '/tf', '/tf_static'
# Seconds between two transforms of the table: a viewer draws no faster.
_PERIOD_S = 1.0 / 30.0


def tf_message_type() -> Any:
    """Return tf2_msgs/TFMessage, None where the package is not installed."""
    try:
        return importlib.import_module('tf2_msgs.msg').TFMessage
    except ImportError:
        return None


def camera_transform(draft: CellDraft, stamp_ns: int) -> TransformStamped | None:
    """Return the fixed transform from ``turntable_base`` to the camera, None without a table."""
    if draft.turntable is None:
        return None
    T = transforms.invert(draft.turntable.camera_from_base)
    return _transform(T, draft.camera_frame, stamp_ns)


def table_transform(angle: float, stamp_ns: int) -> TransformStamped:
    """Return the transform from ``turntable_base`` to ``turntable`` at a table angle, radians."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix()
    return _transform(T, TABLE, stamp_ns)


class CellFrames:
    """
    Publishes the frames of a cell, again when ``cell.yaml`` changes.

    state : of the transforms, for diagnostics
    """

    def __init__(self, node: CellNode, source: CellSource) -> None:
        self._node, self._source = node, source
        wanted = node.parameter(
            'publish_tf',
            True,
            'Publish /tf_static and /tf, where tf2_msgs is installed; false where '
            'robot_state_publisher does.',
            read_only=True,
        )
        self._kind: Any = tf_message_type() if wanted else None
        self.state = 'published' if self._kind else 'off' if not wanted else 'no tf2_msgs'
        self._description = node.publish_on(String, 'robot_description')
        self._static = self._moving = None
        if self._kind is not None:
            self._static = node.publish_on(self._kind, TF_STATIC)
            self._moving = node.publish_on(self._kind, TF)
        self._shown = ''
        self._turned_s = -np.inf
        node.changed(lambda _: self._update())
        self._update()

    def turn(self, stamp_ns: int, angle: float) -> None:
        """Publish the transform of the table, at most 30 times a second."""
        now = self._node.steady_s()
        if self._moving is None or now - self._turned_s < _PERIOD_S:
            return
        self._turned_s = now
        self._moving.publish(self._kind(transforms=[table_transform(angle, stamp_ns)]))

    def _update(self) -> None:
        """Publish what has changed of the cell."""
        draft = self._source.draft
        if draft is None or draft.turntable is None:
            return
        text = urdf(draft)
        if text == self._shown:
            return
        self._shown = text
        self._description.publish(String(data=text))
        if self._static is not None:
            fixed = camera_transform(draft, self._node.now_ns())
            self._static.publish(self._kind(transforms=[fixed]))


def _transform(T: Floats, child: str, stamp_ns: int) -> TransformStamped:
    x, y, z, w = (float(value) for value in Rotation.from_matrix(T[:3, :3]).as_quat())
    place = (float(value) for value in T[:3, 3])
    return TransformStamped(
        header=header(stamp_ns, BASE),
        child_frame_id=child,
        transform=Transform(
            translation=Vector3(**dict(zip('xyz', place, strict=True))),
            rotation=Quaternion(x=x, y=y, z=z, w=w),
        ),
    )
