# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Process of a simulated cell whose table is an axis under ros2_control.

``python -m support.foreign_axis_node FOLDER CELL CAMERA`` writes 'ready' and runs until SIGINT:
joint_states and joint_trajectory are those of the controllers (``foreign_axis``), the lasers are
on a GRBL controller at FOLDER/controller, and a camera can be simulated in the same folder.
"""

import contextlib
from dataclasses import replace
from pathlib import Path
import sys
import threading
import time

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import qos_profile_system_default
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from ivfmc_ros.cell.camera_file import load_camera
from ivfmc_ros.cell.cell_file import load_cell
from ivfmc_ros.simulation.controller_emulator import ControllerEmulator
from ivfmc_ros.simulation.live.folder import LiveDescription
from ivfmc_ros.simulation.live.folder import LiveFolder
from ivfmc_ros.simulation.live.truth import TruthWriter
from ivfmc_ros.simulation.parts.solids import demo_part
from ivfmc_ros.simulation.render.optics import Optics
from ivfmc_ros.simulation.render.optics import with_sheet_thickness
from support.foreign_axis import ForeignAxis

_UPDATE_S = 0.01


class ForeignAxisNode(Node):
    """The two controllers of ros2_control, with the topics that they have by default."""

    def __init__(self, axis: ForeignAxis, truth: TruthWriter, lock: threading.Lock) -> None:
        super().__init__('controller_manager')
        self._axis, self._truth, self._lock = axis, truth, lock
        qos = qos_profile_system_default
        self._states = self.create_publisher(JointState, '/joint_states', qos)
        self.create_subscription(
            JointTrajectory, '/table_controller/joint_trajectory', self._command, qos
        )
        self.create_timer(_UPDATE_S, lambda: self._states.publish(axis.joint_states(time.time())))

    def _command(self, message: JointTrajectory) -> None:
        now_s, steady_s = time.time(), time.monotonic()
        self._axis.command(message, now_s)
        if self._axis.refused:
            self.get_logger().error(self._axis.refused[-1])
        motion = tuple(
            replace(segment, time=segment.time - now_s + steady_s)
            for segment in self._axis.trajectory()
        )
        with self._lock:
            self._truth.write_motion(steady_s, motion)


def main() -> None:
    """Simulate the hardware until SIGINT."""
    rclpy.init()
    folder = LiveFolder(Path(sys.argv[1]))
    folder.folder.mkdir(parents=True, exist_ok=True)
    cell = load_cell(Path(sys.argv[2]), load_camera(Path(sys.argv[3])))
    folder.write(
        LiveDescription(
            cell=with_sheet_thickness(cell, Optics()), solid=demo_part(), optics=Optics(), seed=3
        )
    )
    truth, lock = TruthWriter(folder.truth), threading.Lock()

    def write_lasers(now, outputs):
        with lock:
            truth.write_lasers(now, (outputs.spindle, outputs.coolant))

    lasers = ControllerEmulator(folder.controller, on_outputs=write_lasers)
    lasers.start()
    try:
        node = ForeignAxisNode(ForeignAxis(), truth, lock)
        sys.stdout.write('ready\n')
        sys.stdout.flush()
        with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
            rclpy.spin(node)
    finally:
        lasers.stop()


if __name__ == '__main__':
    main()
