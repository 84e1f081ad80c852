# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Processes that the graph bench starts beside the nodes: an image source and a bare subscriber.

``python graph_processes.py source FRAMES.npy turning`` publishes images at the rates that it reads
from standard input, one per line as 'rate seconds', and prints how many it sent. ``listener``
counts images until none has arrived for 5 s, and prints the count.
"""

import sys
import time

import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import CameraInfo
from sensor_msgs.msg import Image
from sensor_msgs.msg import JointState

from ivfmc_ros.nodes.convert import images
from ivfmc_ros.nodes.convert.stamps import header
from ivfmc_ros.nodes.framework import qos
from ivfmc_ros.simulation.bench import bench_camera

JOINT_PERIOD_NS = 10_000_000
LASER_PERIOD_NS = 100_000_000
SPEED = 0.4


class Source:
    """Camera, table and laser in one process, with one clock."""

    def __init__(self, frames, node, turning):
        def publisher(kind, topic):
            return node.create_publisher(kind, topic, qos.of_topic(topic))

        self.image = publisher(Image, 'image_raw')
        self.info = publisher(CameraInfo, 'camera_info')
        self.joints = publisher(JointState, 'joint_states')
        self.lasers = publisher(JointState, 'laser_states')
        self.required = [self.image, *([self.joints, self.lasers] if turning else [])]
        self.messages = [images.to_image(frame, 0) for frame in frames]
        camera = bench_camera()
        self.camera_info = CameraInfo(
            width=camera.width,
            height=camera.height,
            distortion_model=camera.model,
            d=camera.distortion.tolist(),
            k=camera.K.ravel().tolist(),
        )
        self.next_joint = self.next_laser = self.start = time.time_ns()

    def states(self, now):
        """Publish the states of table and lasers that are due at ``now``, ns."""
        if now >= self.next_joint:
            position = SPEED * (now - self.start) * 1e-9
            self.joints.publish(
                JointState(
                    header=header(now, ''),
                    name=['turntable_joint'],
                    position=[position],
                    velocity=[SPEED],
                )
            )
            self.next_joint += JOINT_PERIOD_NS
        if now >= self.next_laser:
            self.lasers.publish(
                JointState(header=header(now, ''), name=['left', 'right'], position=[1.0, 0.0])
            )
            self.next_laser += LASER_PERIOD_NS

    def picture(self, number, stamp):
        message = self.messages[number % len(self.messages)]
        message.header = header(stamp, 'camera_optical_frame')
        self.camera_info.header = message.header
        self.image.publish(message)
        self.info.publish(self.camera_info)

    def run(self, rate, seconds):
        """Publish images for ``seconds``; return their number and the elapsed seconds."""
        while not all(p.get_subscription_count() for p in self.required):
            time.sleep(0.05)
        time.sleep(1.0)
        period = int(1e9 / rate)
        self.next_joint = self.next_laser = time.time_ns()
        begin = due = time.time_ns()
        sent = 0
        while time.time_ns() < begin + seconds * 1e9:
            now = time.time_ns()
            self.states(now)
            if now >= due:
                self.picture(sent, now)
                sent += 1
                due += period
            wait = min(due, self.next_joint) - time.time_ns()
            if wait > 0:
                time.sleep(wait * 1e-9)
        elapsed = (time.time_ns() - begin) * 1e-9
        # the table's states have to bracket the last image
        end_of_states = time.time_ns() + 300_000_000
        while time.time_ns() < end_of_states:
            self.states(time.time_ns())
            time.sleep(0.005)
        return sent, elapsed


def source(path, turning):
    rclpy.init()
    node = rclpy.create_node('source', namespace='/ivfmc')
    frames = Source(np.load(path), node, turning)
    print('ready', flush=True)
    for line in sys.stdin:
        rate, seconds = map(float, line.split())
        sent, elapsed = frames.run(rate, seconds)
        print(sent, elapsed, flush=True)


def listener():
    rclpy.init()
    node = rclpy.create_node('listener', namespace='/ivfmc')
    stamps = []
    node.create_subscription(
        Image, 'image_raw', lambda m: stamps.append(m.header.stamp.sec), qos.of_topic('image_raw')
    )
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    print('ready', flush=True)
    silent = time.monotonic()
    seen = 0
    while time.monotonic() - silent < 5.0 or not stamps:
        executor.spin_once(timeout_sec=0.1)
        if len(stamps) != seen:
            seen, silent = len(stamps), time.monotonic()
    print(seen, flush=True)


if __name__ == '__main__':
    source(sys.argv[2], sys.argv[3] == 'turning') if sys.argv[1] == 'source' else listener()
