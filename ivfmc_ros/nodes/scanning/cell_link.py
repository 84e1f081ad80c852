# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the orchestrator hears of the cell, and the two topics by which it moves it."""

from collections import deque
from dataclasses import dataclass
from functools import partial
import math
from typing import Any

from builtin_interfaces.msg import Duration
from sensor_msgs.msg import CameraInfo
from sensor_msgs.msg import JointState
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header
from std_msgs.msg import UInt64
from trajectory_msgs.msg import JointTrajectory
from trajectory_msgs.msg import JointTrajectoryPoint

from ivfmc_ros.errors import HelperError
from ivfmc_ros.nodes.convert.stamps import nanoseconds
from ivfmc_ros.nodes.framework.adaptive_subscription import AdaptiveSubscription
from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.scan.watch import Watch
from ivfmc_ros.storage.messages.profile_head import ProfileHead
from ivfmc_ros.storage.messages.profile_head import read_head
from ivfmc_ros.storage.reports import joint_of

# The driver turns the lasers off after half a second without one.
HOLD_S = 0.1
HELPERS = ('camera', 'turntable', 'triangulator', 'registrar', 'mesher', 'recorder')
JOINTS = 'joint_states'

# A table stands when it said so this often in a row.
_STILL_REPORTS = 4
_STILL_VELOCITY = 5e-3  # rad/s
# So many profiles may come before somebody looks.
_LATEST = 50


@dataclass(frozen=True, kw_only=True)
class Report:
    """Where the table was, radians and radians per second."""

    stamp_ns: int
    position: float
    velocity: float


class CellLink:
    """Ears and hands of the orchestrator."""

    def __init__(self, node: CellNode, joint: str, limit: float) -> None:
        """
        Begin to listen.

        joint : of the table, in joint_states
        limit : seconds of silence after which somebody is lost
        """
        self.watch = Watch(limit)
        self.joint = joint
        self.reports: deque[Report] = deque(maxlen=50)
        self.lasers: dict[str, bool] = {}
        # stamp of the first report since which all lasers are off; None while one is on
        self.dark_since_ns: int | None = None
        # stamp of the last picture that was taken
        self.pictured_ns = 0
        self.recorded: int | None = None
        self.heads: dict[int, ProfileHead] = {}
        # since when profiles wait for the recorder, or when it last wrote one; None: none waits
        self._behind_since: float | None = None
        self._counted_twice: int | None = None
        self._node = node
        self._beam: str | None = None
        self._closed = False
        self._hold = node.publish_on(Header, 'beam_hold')
        self._trajectory = node.publish_on(JointTrajectory, 'joint_trajectory')
        self._keep = [
            AdaptiveSubscription(node, JointState, JOINTS, self._hear_joints),
            AdaptiveSubscription(node, CameraInfo, 'camera_info', self._hear_camera),
            node.subscribe(JointState, 'laser_states', self._hear_lasers),
            node.subscribe(PointCloud2, 'profile', self._hear_profile),
            node.subscribe(UInt64, 'recorded', self._hear_recorded),
            node.steady_timer(HOLD_S, self._hold_beam),
        ]
        for name in HELPERS:
            heard = partial(self._hear_beat, name)
            self._keep.append(node.subscribe(Header, f'{name}/heartbeat', heard))

    @property
    def position(self) -> float | None:
        """Of the table, radians; None while nothing is known."""
        return self.reports[-1].position if self.reports else None

    @property
    def beam(self) -> str | None:
        """The laser that is asked for; None when no frames are wanted."""
        return self._beam

    def forget(self) -> None:
        """Begin a new scan: profiles are counted from 0."""
        self.heads.clear()
        self.recorded = self._behind_since = self._counted_twice = None

    def require_one_count(self) -> None:
        """:raises HelperError: profiles were counted from 0 again."""
        if self._counted_twice is not None:
            raise HelperError(
                'TRIANGULATOR_LOST',
                f'profile {self._counted_twice} came twice: the triangulator was started again '
                'during the scan, or there are two',
            )

    @property
    def unrecorded_s(self) -> float:
        """For how long profiles have come and the recorder has written none, seconds."""
        since = self._behind_since
        return 0.0 if since is None else self._node.steady_s() - since

    def close(self) -> None:
        """Turn all lasers off and stop the table where it is; say nothing more from then on."""
        self.hold(None)
        self.halt()
        self._closed = True

    def hold(self, laser: str | None) -> None:
        """Ask for one laser until told otherwise; None turns all off and falls silent."""
        if self._closed:
            return
        self._beam = laser
        # at once, and for None the last word: an empty name is no laser
        self._hold.publish(self._header(laser or ''))

    def send(self, position: float, seconds: float) -> None:
        """Command the table to be at a position (radians) in so many seconds, and to stand."""
        whole = int(seconds)
        point = JointTrajectoryPoint(
            positions=[position],
            velocities=[0.0],
            time_from_start=Duration(sec=whole, nanosec=int((seconds - whole) * 1e9)),
        )
        # a stamp of zero is 'now' for a trajectory controller
        self._trajectory.publish(JointTrajectory(joint_names=[self.joint], points=[point]))

    def halt(self) -> None:
        """Command the table to stand where it is: so a trajectory controller is stopped."""
        position = self.position
        if position is not None and not self._closed:
            self.send(position, 0.2)

    def has_table(self) -> bool:
        """Tell whether somebody takes commands."""
        return bool(self._node.count_subscribers(self._trajectory.topic_name))

    def stands_at(self, position: float, tolerance: float) -> bool:
        """Tell whether the table has said often enough that it stands at a position."""
        last = list(self.reports)[-_STILL_REPORTS:]
        return len(last) == _STILL_REPORTS and all(
            abs(report.position - position) <= tolerance
            and abs(report.velocity) <= _STILL_VELOCITY
            for report in last
        )

    @property
    def stood_ns(self) -> int:
        """Since when the table has said that it stands, nanoseconds of the reports' stamps."""
        last = list(self.reports)[-_STILL_REPORTS:]
        return last[0].stamp_ns if last else 0

    def latest(self) -> list[ProfileHead]:
        """Return the heads of the last profiles, the newest one first."""
        return [self.heads[seq] for seq in sorted(self.heads)[: -_LATEST - 1 : -1]]

    def shines(self, laser: str) -> bool:
        """Tell whether this laser is on and no other; true where nobody tells of lasers."""
        if self._node.count_publishers('laser_states') == 0:
            return True
        return self.lasers.get(laser, False) and sum(self.lasers.values()) == 1

    def _header(self, frame_id: str) -> Header:
        header = Header(frame_id=frame_id)
        header.stamp = self._node.get_clock().now().to_msg()
        return header

    def _hold_beam(self) -> None:
        if self._beam is not None:
            self._hold.publish(self._header(self._beam))

    def _hear_beat(self, name: str, _: Header) -> None:
        self.watch.hear(name)

    def _hear_joints(self, message: JointState) -> None:
        stated = joint_of(message, self.joint)
        if stated is None:
            return
        stamp_ns = nanoseconds(message.header.stamp)
        position, velocity = stated
        if velocity is None:
            velocity = self._difference(stamp_ns, position)
        self.watch.hear(JOINTS)
        self.reports.append(Report(stamp_ns=stamp_ns, position=position, velocity=velocity))

    def _difference(self, stamp_ns: int, position: float) -> float:
        """Return the velocity of a table that does not report it, rad/s."""
        if not self.reports:
            return math.inf
        last = self.reports[-1]
        seconds = (stamp_ns - last.stamp_ns) * 1e-9
        return (position - last.position) / seconds if seconds > 0.0 else last.velocity

    def _hear_camera(self, message: CameraInfo) -> None:
        self.pictured_ns = nanoseconds(message.header.stamp)

    def _hear_lasers(self, message: JointState) -> None:
        self.lasers = {
            name: value > 0.5 for name, value in zip(message.name, message.position, strict=False)
        }
        if any(self.lasers.values()):
            self.dark_since_ns = None
        elif self.dark_since_ns is None:
            self.dark_since_ns = nanoseconds(message.header.stamp)

    def _hear_profile(self, message: Any) -> None:
        head = read_head(message)
        known = self.heads.setdefault(head.seq, head)
        if known.stamp_ns != head.stamp_ns:
            self._counted_twice = head.seq
        recorded = self.recorded is not None and self.recorded >= head.seq
        if self._behind_since is None and not recorded:
            self._behind_since = self._node.steady_s()

    def _hear_recorded(self, message: UInt64) -> None:
        self.recorded = int(message.data)
        waiting = self.recorded < max(self.heads, default=0)
        self._behind_since = self._node.steady_s() if waiting else None
