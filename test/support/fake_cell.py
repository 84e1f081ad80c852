# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Everything that the orchestrator needs of a cell, in the process of the test.

The table is a foreign one under a trajectory controller: no home, no stop, no lasers of its own,
and it tells no velocity.
"""

import json
from pathlib import Path
import time

import numpy as np
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
from support.synthetic import small_cell

HELPERS = ('triangulator', 'registrar', 'mesher', 'recorder')


class FakeCell:
    """
    A cell that does what it is told to do wrong.

    ``silent``: those whose hearts do not beat; ``answers``: what a service answers instead, a list
    one after the other.
    """

    def __init__(self, client):
        self.client = client
        self.silent = set()
        self.answers = {}
        self.called = []
        self.holds = []
        self.heads = []
        self.meanwhile = {}  # what is called when a service is
        self.stuck = set()  # services that never answer
        self.velocities = []
        self.always_on = None  # a laser that nobody can turn off
        self.behind = 0  # profiles that the recorder has not flushed
        self.calibrated = True
        self.motion = (0.0, 0.0, 0.0, 0.0)  # from, to, begin, end
        self.seq = 0
        self.last = {}
        self.nodes = {name: self._helper(name) for name in HELPERS}
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
        node.create_timer(0.02, self._joints)
        node.create_timer(0.05, self._tick)

    def close(self):
        for node in (self.node, *self.nodes.values()):
            self.client.executor.remove_node(node)
            node.destroy_node()

    @property
    def position(self):
        start, target, begin, end = self.motion
        now = time.monotonic()
        share = 1.0 if now >= end else (now - begin) / (end - begin)
        return start + (target - start) * share

    @property
    def beam(self):
        """The laser that a driver would keep on now."""
        if not self.holds or time.monotonic() - self.holds[-1][0] > 0.5:
            return ''
        return self.holds[-1][1]

    def parameter(self, node, name):
        return self.nodes[node].get_parameter(name).value

    def _helper(self, name):
        node = Node(name, namespace='/ivfmc', context=self.client.context)
        node.declare_parameter('scan_id', '')
        node.declare_parameter('scan_folder', '')
        node.declare_parameter('motion', '')
        node.declare_parameter('pictures', True)
        node.declare_parameter('subtract_dark', False)
        node.declare_parameter('formats', ['stl'])
        node.declare_parameter('export_unit', '')
        node.declare_parameter('view', [-1, -1])
        node.declare_parameter('expected', 0)
        # what is stuck must not keep others from being answered
        group = ReentrantCallbackGroup()
        for service in ('reset', 'register', 'build', 'start', 'stop', 'cancel'):
            path = f'{name}/{service}'
            node.create_service(Trigger, path, self._answerer(path), callback_group=group)
        self.client.executor.add_node(node)
        return node

    def _answerer(self, path):
        async def answer(_, response):
            self.called.append(path)
            if path in self.stuck:
                await Future(executor=self.client.executor)
            if path == 'recorder/start':
                self.seq, self.last = 0, {}
            if path == 'mesher/build':
                part = demo_part()
                folder = Path(self.parameter('mesher', 'scan_folder'))
                write_solid(folder / 'mesh.stl', part.vertices_xyz, part.faces)
            self.meanwhile.get(path, lambda: None)()
            message = self.answers.get(path, {'code': 'OK', 'said': path})
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
        return Header(frame_id=name, stamp=self.node.get_clock().now().to_msg())

    def _joints(self):
        joints = JointState(name=['other', 'turntable_joint'], position=[9.0, self.position])
        joints.velocity = self.velocities
        joints.header = self._header()
        self.joints.publish(joints)

    def _tick(self):
        for name, publisher in self.beats.items():
            if name not in self.silent:
                publisher.publish(self._header(name))
        camera = small_cell().camera
        info = CameraInfo(width=camera.width, height=camera.height, distortion_model=camera.model)
        info.k = camera.K.ravel().tolist() if self.calibrated else [0.0] * 9
        info.d = camera.distortion.tolist()
        info.header = self._header()
        self.infos.publish(info)
        before = self.seq
        self._picture()
        if before == self.seq and 0 < self.behind <= before:
            # a recorder to which nothing comes any more is soon done
            self.recorded.publish(UInt64(data=before - 1))

    def _picture(self):
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
            stamp_ns=self.node.get_clock().now().nanoseconds,
        )
        self.profiles.publish(clouds.from_profile(profile))
        if self.seq >= self.behind:
            self.recorded.publish(UInt64(data=self.seq - self.behind))
        self.seq += 1
