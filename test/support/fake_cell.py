# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Fake nodes and topics of a cell for tests of the orchestrator, in the process of the test.

The table stands for one under joint_trajectory_controller: it has no services home and stop, no
lasers, and its joint_states have no velocity.
"""

import json
from pathlib import Path
import time

from diagnostic_msgs.msg import DiagnosticArray
from diagnostic_msgs.msg import DiagnosticStatus
from diagnostic_msgs.msg import KeyValue
import numpy as np
from rcl_interfaces.msg import SetParametersResult
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future
from sensor_msgs.msg import CameraInfo
from sensor_msgs.msg import JointState
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header
from std_msgs.msg import UInt64
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from ivfmc_ros.meshing.io.export import write_solid
from ivfmc_ros.model import Profile
from ivfmc_ros.nodes.convert import clouds
from ivfmc_ros.nodes.framework import qos
from ivfmc_ros.simulation.parts.solids import demo_part
from ivfmc_ros.storage.messages import cdr
from support.synthetic import small_cell

HELPERS = ('triangulator', 'registrar', 'mesher', 'recorder')
# Seconds; the camera of the fake cell refuses what is longer than its period.
LONGEST_EXPOSURE = 0.05


class FakeCell:
    """
    A cell whose faults a test can choose.

    without_heartbeat : names of nodes that publish no heartbeat
    responses : response of a service by its name, instead of OK; a list is used one by one
    called : names of the services that were called, in order
    holds : (monotonic second, laser) of each beam_hold
    on_call : function by the name of the service that calls it
    hanging : names of services that never respond
    velocities : of joint_states
    always_on : a laser that is on whatever beam_hold says
    recorder_lag : profiles that the recorder has not flushed
    calibrated : whether camera_info has a camera matrix
    stands_from : position of the table, radians, beyond which it does not move
    clock_change_s : seconds by which the clock of camera and table was set
    stalls : ranges of the position of the table, radians, where the camera stands still
    triggered : values that the parameter of the camera was set to, in order
    """

    def __init__(self, client):
        self.client = client
        # made before the scan: on a busy computer it takes longer than a heartbeat may be late
        self.part = demo_part()
        self.without_heartbeat = set()
        self.responses = {}
        self.called = []
        self.holds = []
        self.on_call = {}
        self.hanging = set()
        self.velocities = []
        self.always_on = None
        self.recorder_lag = 0
        self.calibrated = True
        self.clock_change_s = 0.0
        self.stands_from = float('inf')
        self.stalls = []
        self.triggered = []
        self.exposed = []
        self.motion = (0.0, 0.0, 0.0, 0.0)  # start and target in radians, begin and end in seconds
        self.seq = 0
        self.last = {}
        self.nodes = {name: self._create_node(name) for name in HELPERS}
        node = self.node = Node('cell', namespace='/ivfmc', context=client.context)
        client.executor.add_node(node)
        self.joints = node.create_publisher(JointState, 'joint_states', qos.best_effort(10))
        self.profiles = node.create_publisher(PointCloud2, 'profile', qos.of_topic('profile'))
        self.recorded = node.create_publisher(UInt64, 'recorded', qos.of_topic('recorded'))
        self.infos = node.create_publisher(CameraInfo, 'camera_info', qos.of_topic('camera_info'))
        node.create_subscription(JointTrajectory, 'joint_trajectory', self._command, 10)
        node.create_subscription(Header, 'beam_hold', self._hold, 10)
        self.beats = {
            name: helper.create_publisher(Header, f'{name}/heartbeat', 10)
            for name, helper in self.nodes.items()
        }
        self.diagnostics = node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        node.create_timer(0.02, self._publish_joints)
        node.create_timer(0.05, self._publish_images_and_heartbeats)

    def close(self):
        for node in (self.node, *self.nodes.values()):
            self.client.executor.remove_node(node)
            node.destroy_node()

    def add_camera(self, trigger):
        """Add a node camera with a trigger line; while triggered it exposes in motion only."""
        node = Node('camera', namespace='/ivfmc', context=self.client.context)
        node.declare_parameter('trigger', trigger)
        node.declare_parameter('triggered', True)
        node.declare_parameter('exposure', 0.005)

        def note(parameters):
            self.triggered += [p.value for p in parameters if p.name == 'triggered']
            exposed = [p.value for p in parameters if p.name == 'exposure']
            if max(exposed, default=0.0) > LONGEST_EXPOSURE:
                return SetParametersResult(successful=False, reason='longer than a period')
            self.exposed += exposed
            return SetParametersResult(successful=True)

        node.add_on_set_parameters_callback(note)
        self.client.executor.add_node(node)
        self.nodes['camera'] = node

    @property
    def position(self):
        start, target, begin, end = self.motion
        now = time.monotonic()
        share = 1.0 if now >= end else (now - begin) / (end - begin)
        return min(start + (target - start) * share, self.stands_from)

    @property
    def beam(self):
        """Name of the laser that a driver would keep on now, '' for none."""
        if not self.holds or time.monotonic() - self.holds[-1][0] > 0.5:
            return ''
        return self.holds[-1][1]

    def parameter(self, node, name):
        return self.nodes[node].get_parameter(name).value

    def _create_node(self, name):
        node = Node(name, namespace='/ivfmc', context=self.client.context)
        node.declare_parameter('scan_id', '')
        node.declare_parameter('min_step', 1e-3)
        node.declare_parameter('scan_folder', '')
        node.declare_parameter('motion', '')
        node.declare_parameter('pictures', True)
        node.declare_parameter('owner', '')
        node.declare_parameter('subtract_dark', False)
        node.declare_parameter('formats', ['stl'])
        node.declare_parameter('export_unit', '')
        node.declare_parameter('view', [-1, -1])
        node.declare_parameter('expected', 0)
        node.declare_parameter('first_profile', 0)
        node.declare_parameter('working_radius', 0.0)
        node.declare_parameter('working_top', 0.0)
        node.declare_parameter('volume.radius', 0.055)
        node.declare_parameter('volume.top', 0.09)
        node.declare_parameter('exposure', 0.01)
        # a hanging service must not delay the others
        group = ReentrantCallbackGroup()
        for service in ('reset', 'load', 'register', 'build', 'start', 'stop', 'cancel'):
            path = f'{name}/{service}'
            node.create_service(Trigger, path, self._service_callback(path), callback_group=group)
        self.client.executor.add_node(node)
        return node

    def _service_callback(self, path):
        async def answer(_, response):
            self.called.append(path)
            if path in self.hanging:
                await Future(executor=self.client.executor)
            if path == 'recorder/start':
                self.seq, self.last = self.parameter('recorder', 'first_profile'), {}
            if path == 'mesher/build':
                folder = Path(self.parameter('mesher', 'scan_folder'))
                write_solid(folder / 'mesh.stl', self.part.vertices_xyz, self.part.faces)
            self.on_call.get(path, lambda: None)()
            message = self.responses.get(path, {'code': 'OK', 'said': path})
            if isinstance(message, list):
                message = message.pop(0)
            response.success = message['code'] == 'OK'
            response.message = json.dumps(message)
            return response

        return answer

    def _command(self, message):
        point = message.points[0]
        assert list(point.velocities) == [0.0]
        now = time.monotonic()
        seconds = point.time_from_start.sec + point.time_from_start.nanosec * 1e-9
        here = self.position
        self.motion = (here, point.positions[0], now, now + seconds)

    def _hold(self, message):
        self.holds.append((time.monotonic(), message.frame_id))

    def _header(self, name=''):
        header = Header(frame_id=name)
        header.stamp.sec, header.stamp.nanosec = divmod(self._now_ns(), 1_000_000_000)
        return header

    def _now_ns(self):
        return self.node.get_clock().now().nanoseconds + round(self.clock_change_s * 1e9)

    def fault_of_controller(self, code, text, name='ivfmc/turntable'):
        """Publish the diagnostics of a turntable node."""
        status = DiagnosticStatus(level=bytes([2 if code else 0]), name=name, message=text)
        status.values = [KeyValue(key='code', value=code)]
        self.diagnostics.publish(DiagnosticArray(status=[status]))

    def say_zero(self, zero):
        """Publish the identity of the table's zero, as the diagnostics of a turntable node."""
        status = DiagnosticStatus(level=bytes([0]), name='ivfmc/turntable')
        status.values = [KeyValue(key='code', value=''), KeyValue(key='zero', value=zero)]
        self.diagnostics.publish(DiagnosticArray(status=[status]))

    def say_of_triangulator(self, name='ivfmc/triangulator', **values):
        """Publish values in the diagnostics of a triangulator."""
        status = DiagnosticStatus(level=bytes([1]), name=name)
        status.values = [KeyValue(key=key, value=value) for key, value in values.items()]
        self.diagnostics.publish(DiagnosticArray(status=[status]))

    def _publish_joints(self):
        joints = JointState(name=['other', 'turntable_joint'], position=[9.0, self.position])
        joints.velocity = self.velocities
        joints.header = self._header()
        self.joints.publish(joints)

    def _publish_images_and_heartbeats(self):
        for name, publisher in self.beats.items():
            if name not in self.without_heartbeat:
                publisher.publish(self._header(name))
        if any(low <= self.position < high for low, high in self.stalls):
            return
        stands = time.monotonic() >= self.motion[3]
        if stands and self.triggered and self.triggered[-1]:
            return
        camera = small_cell().camera
        info = CameraInfo(width=camera.width, height=camera.height, distortion_model=camera.model)
        info.k = camera.K.ravel().tolist() if self.calibrated else [0.0] * 9
        info.d = camera.distortion.tolist()
        info.header = self._header()
        self.infos.publish(info)
        before = self.seq
        self._publish_profile(cdr.stamp_ns(info))
        if before == self.seq and 0 < self.recorder_lag <= before:
            # without new profiles the recorder soon catches up
            self.recorded.publish(UInt64(data=before - 1))

    def _publish_profile(self, stamp_ns):
        names = [laser.name for laser in small_cell().lasers]
        views = self.parameter('triangulator', 'view')
        beam = self.always_on or self.beam
        if beam not in names or views[names.index(beam)] < 0:
            return
        laser = names.index(beam)
        moving = time.monotonic() < self.motion[3] + 0.1
        step = self.parameter('triangulator', 'motion') == 'step'
        if step and (moving or abs(self.last.get(laser, 1e9) - self.position) < 1e-3):
            return
        self.last[laser] = self.position
        profile = Profile(
            points_xyz=np.zeros((5, 3)),
            intensity=np.zeros(5),
            sigma=np.zeros(5),
            uv=np.zeros((5, 2)),
            angle=self.position,
            laser=laser,
            view=views[laser],
            seq=self.seq,
            stamp_ns=stamp_ns,
        )
        self.profiles.publish(clouds.from_profile(profile))
        if self.seq >= self.recorder_lag:
            self.recorded.publish(UInt64(data=self.seq - self.recorder_lag))
        self.seq += 1
