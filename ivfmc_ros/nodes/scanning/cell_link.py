# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The orchestrator's subscriptions to the cell, and its commands to table and lasers."""

from typing import Any

from rclpy.qos import ReliabilityPolicy
from sensor_msgs.msg import CameraInfo
from sensor_msgs.msg import JointState
from sensor_msgs.msg import PointCloud2
from sensor_msgs.msg import Temperature
from std_msgs.msg import Header
from std_msgs.msg import UInt64
from trajectory_msgs.msg import JointTrajectory

from ivfmc_ros.errors import HelperError
from ivfmc_ros.nodes.convert.stamps import nanoseconds
from ivfmc_ros.nodes.convert.trajectory import trajectory_to
from ivfmc_ros.nodes.framework.adaptive_subscription import AdaptiveSubscription
from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.nodes.framework.heartbeats import Heartbeats
from ivfmc_ros.nodes.scanning.diagnostics_watch import DiagnosticsWatch
from ivfmc_ros.scan.clock_monitor import ClockMonitor
from ivfmc_ros.scan.liveness import AttentiveClock
from ivfmc_ros.scan.liveness import LivenessMonitor
from ivfmc_ros.scan.table_reports import TableReports
from ivfmc_ros.scan.temperature import TemperatureLog
from ivfmc_ros.storage.matching.joint_history import joint_in_message
from ivfmc_ros.storage.messages.profile_header import ProfileHeader
from ivfmc_ros.storage.messages.profile_header import read_profile_header
from ivfmc_ros.storage.recording.taken_profiles import TakenProfiles

# Period of beam_hold, seconds: the driver turns the lasers off after 0.5 s without one.
HOLD_S = 0.1
HELPERS = ('camera', 'turntable', 'triangulator', 'registrar', 'mesher', 'recorder')
JOINTS = 'joint_states'

# Profiles that ``latest_profiles`` returns: more than are received between two polls.
_LATEST = 50
# A reading of the temperature before the scan counts for it if it is not older, seconds.
_READING_S = 300.0
# Duration of the move that stops the table where it is, seconds.
_HALT_S = 0.2


class CellLink:
    """
    Keeps what the nodes of the cell publish, and publishes joint_trajectory and beam_hold.

    watch : ages of heartbeats and joint states
    clocks : jumps of the clocks since the start of the scan
    info_stamps_ns : stamps of all camera_info of the scan
    table : its last joint states
    diagnostics : faults that the nodes of the cell say
    lasers : whether each laser is on
    dark_since_ns : stamp since which all lasers are off; None while one is on
    last_image_ns : stamp of the last image
    recorded : number of the last profile on disk
    headers : header of each profile of the scan, by its number
    temperature : readings of the sensor during the scan
    """

    def __init__(self, node: CellNode, joint: str, limit: float) -> None:
        """
        Subscribe.

        joint : joint name of the table in joint_states
        limit : seconds of silence after which a node is lost
        """
        # seconds in which this node itself was on time: what waits in its queues is not late
        self._attentive = AttentiveClock(HOLD_S, node.steady_s)
        self.watch = LivenessMonitor(limit, self._attentive)
        self.clocks = ClockMonitor(node.steady_s)
        self.info_stamps_ns: list[int] = []
        self.joint = joint
        self.table = TableReports()
        self.lasers: dict[str, bool] = {}
        self.dark_since_ns: int | None = None
        self.last_image_ns = 0
        self.recorded: int | None = None
        self.headers: dict[int, ProfileHeader] = {}
        self.temperature = TemperatureLog(0.0)
        # a sensor may give a reading a minute
        self._last_reading: Temperature | None = None
        # since when profiles are not on disk yet, or when one last was; None: all are
        self._unrecorded_since: float | None = None
        self._repeated_seq: int | None = None
        self._node = node
        self._beam: str | None = None
        self._closed = False
        self._heartbeats = Heartbeats(node, HELPERS, self.watch.heartbeat)
        self.diagnostics = DiagnosticsWatch(node, self._end)
        self._hold = node.publish_on(Header, 'beam_hold')
        self._trajectory = node.publish_on(JointTrajectory, 'joint_trajectory')
        # of a scan only: in an idle cell every image would wake this node
        self._infos = AdaptiveSubscription(node, CameraInfo, 'camera_info', self._receive_camera)
        self._infos.pause()
        self._subscriptions = [
            AdaptiveSubscription(node, JointState, JOINTS, self._receive_joints),
            node.subscribe(JointState, 'laser_states', self._receive_lasers),
            node.subscribe(PointCloud2, 'profile', self._receive_profile),
            node.subscribe(UInt64, 'recorded', self._receive_recorded),
            node.subscribe(Temperature, 'temperature', self._receive_temperature),
            node.steady_timer(HOLD_S, self._tick),
        ]

    @property
    def position(self) -> float | None:
        """Position of the table, radians; None before the first joint state."""
        return self.table.last.position if self.table.last else None

    @property
    def beam(self) -> str | None:
        """The laser that is requested; None for none."""
        return self._beam

    def start_scan(self) -> None:
        """Forget the profiles of the previous scan; their numbers start at 0 again."""
        self._infos.resume()
        self.headers.clear()
        self.clocks.reset()
        self.info_stamps_ns.clear()
        self.recorded = self._unrecorded_since = self._repeated_seq = None
        self.temperature = TemperatureLog(self._node.get('temperature_u'))
        if self._last_reading is not None and self._age_s(self._last_reading) < _READING_S:
            self._receive_temperature(self._last_reading)

    def take_over(self, taken: TakenProfiles) -> None:
        """Know the profiles of the bag of a scan that goes on."""
        self.headers.update({place.header.seq: place.header for place in taken.locations})
        self.info_stamps_ns[:0] = taken.info_stamps_ns

    def end_scan(self) -> None:
        """Receive no camera_info until the next scan."""
        self._infos.pause()

    def require_unique_profiles(self) -> None:
        """:raises HelperError: two profiles of the scan have the same number."""
        if self._repeated_seq is not None:
            raise HelperError(
                'TRIANGULATOR_LOST',
                f'profile {self._repeated_seq} was received twice: the triangulator was restarted '
                'during the scan, or two of them are running',
            )

    @property
    def unrecorded_s(self) -> float:
        """Seconds since the recorder wrote a profile while others wait; 0: none waits."""
        since = self._unrecorded_since
        return 0.0 if since is None else self._attentive() - since

    def close(self) -> None:
        """Turn all lasers off, stop the table, and publish nothing any more."""
        self.hold(None)
        self.halt()
        self._closed = True

    def hold(self, laser: str | None) -> None:
        """Request one laser repeatedly; None turns all off and ends the keep-alive."""
        if self._closed:
            return
        self._beam = laser
        # an empty name turns all lasers off at once
        self._hold.publish(self._header(laser or ''))

    def command(self, position: float, seconds: float) -> None:
        """Command the table to ``position`` (radians) within ``seconds``, ending at standstill."""
        self.table.begin_move()
        self._trajectory.publish(trajectory_to(self.joint, position, seconds))

    def halt(self) -> None:
        """Stop the table: command its present position, as joint_trajectory_controller has it."""
        position = self.position
        if position is not None and not self._closed:
            self.command(position, _HALT_S)

    def has_table(self) -> bool:
        """Return whether joint_trajectory has a subscription."""
        return bool(self._node.count_subscribers(self._trajectory.topic_name))

    def may_lose_commands(self) -> bool:
        """Return whether the driver of the table subscribes its commands best effort."""
        found = self._node.get_subscriptions_info_by_topic(self._trajectory.topic_name)
        return any(info.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT for info in found)

    def latest_profiles(self) -> list[ProfileHeader]:
        """Return the headers of the last profiles, the newest first."""
        return [self.headers[seq] for seq in sorted(self.headers)[: -_LATEST - 1 : -1]]

    def is_on(self, laser: str) -> bool:
        """Return whether only this laser is on; true where no node publishes laser_states."""
        if self._node.count_publishers('laser_states') == 0:
            return True
        return self.lasers.get(laser, False) and sum(self.lasers.values()) == 1

    def _receive_temperature(self, message: Temperature) -> None:
        self._last_reading = message
        self.temperature.add(message.temperature, message.variance)

    def _age_s(self, message: Temperature) -> float:
        now_ns = self._node.get_clock().now().nanoseconds
        return float(1e-9 * abs(now_ns - nanoseconds(message.header.stamp)))

    def _header(self, frame_id: str) -> Header:
        header = Header(frame_id=frame_id)
        header.stamp = self._node.get_clock().now().to_msg()
        return header

    def _tick(self) -> None:
        self._heartbeats.fetch()
        self._attentive.tick()
        if not self._is_simulated_time:
            self.clocks.check_own_clock()
        if self._beam is not None:
            self._hold.publish(self._header(self._beam))

    def _end(self, name: str, reason: str) -> None:
        # its last heartbeat must not be taken for the first one of its next life
        self._heartbeats.fetch()
        self.watch.end(name, reason)

    def _receive_joints(self, message: JointState) -> None:
        state = joint_in_message(message, self.joint)
        if state is None:
            return
        stamp_ns = nanoseconds(message.header.stamp)
        self.watch.heartbeat(JOINTS)
        self._check_stamp(JOINTS, stamp_ns)
        self.table.add(stamp_ns, *state)

    def _receive_camera(self, message: CameraInfo) -> None:
        self.last_image_ns = nanoseconds(message.header.stamp)
        self.info_stamps_ns.append(self.last_image_ns)
        self._check_stamp('camera_info', self.last_image_ns)

    @property
    def _is_simulated_time(self) -> bool:
        return bool(self._node.get_parameter('use_sim_time').value)

    def _check_stamp(self, topic: str, stamp_ns: int) -> None:
        # simulated time stands still and runs at any speed
        if not self._is_simulated_time:
            self.clocks.add(topic, stamp_ns)

    def _receive_lasers(self, message: JointState) -> None:
        self.lasers = {
            name: value > 0.5 for name, value in zip(message.name, message.position, strict=False)
        }
        if any(self.lasers.values()):
            self.dark_since_ns = None
        elif self.dark_since_ns is None:
            self.dark_since_ns = nanoseconds(message.header.stamp)

    def _receive_profile(self, message: Any) -> None:
        header = read_profile_header(message)
        # a triangulator that is busy with images is late with its heartbeats
        self.watch.heartbeat('triangulator')
        known = self.headers.setdefault(header.seq, header)
        if known.stamp_ns != header.stamp_ns:
            self._repeated_seq = header.seq
        recorded = self.recorded is not None and self.recorded >= header.seq
        if self._unrecorded_since is None and not recorded:
            self._unrecorded_since = self._attentive()

    def _receive_recorded(self, message: UInt64) -> None:
        self.recorded = int(message.data)
        waiting = self.recorded < max(self.headers, default=0)
        self._unrecorded_since = self._attentive() if waiting else None
