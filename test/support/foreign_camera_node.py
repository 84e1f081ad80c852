# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Process that publishes the images of a simulated cell as a camera driver of another package.

``python -m support.foreign_camera_node FOLDER DRIVER`` writes 'ready' and runs until
SIGINT; DRIVER is one of DRIVERS.
"""

from collections import deque
import contextlib
from pathlib import Path
import sys
import threading
import time
from typing import Any

import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo
from sensor_msgs.msg import Image

from ivfmc_ros.cell.camera_file import load_camera
from ivfmc_ros.devices.cameras.device import CameraImage
from ivfmc_ros.devices.cameras.device import Exposure
from ivfmc_ros.nodes.camera import camera_info
from ivfmc_ros.nodes.convert.stamps import header
from ivfmc_ros.simulation.live.camera import SimulatedCamera
from support.foreign_camera import DRIVERS
from support.foreign_camera import EXPOSURE_S
from support.foreign_camera import image_message

_FRAME_RATE = 15.0
# Seconds from the stamp to the message, and between two looks for images that are due.
_TRANSPORT_S, _POLL_S = 0.01, 0.005


class ForeignCameraNode(Node):
    """Publishes on the topics of the driver, with its QoS, encoding, late stamps and repeats."""

    def __init__(self, folder: Path, driver: str) -> None:
        super().__init__('camera_driver', namespace='/ivfmc')
        self._driver = DRIVERS[driver]
        images, infos = self._driver.topics
        self._images = self.create_publisher(Image, images, self._driver.qos)
        self._infos = self.create_publisher(CameraInfo, infos, self._driver.qos)
        self._calibration = load_camera(folder / 'camera.yaml')
        self._rng = np.random.default_rng(0)
        self._count = 0
        self._due: deque[tuple[float, int, Any]] = deque()
        self._camera = SimulatedCamera(
            folder, Exposure(frame_rate=_FRAME_RATE, seconds=EXPOSURE_S)
        )
        self.create_timer(_POLL_S, self._publish_due)
        threading.Thread(target=self._grab, daemon=True).start()

    def _grab(self) -> None:
        self._camera.open()
        while rclpy.ok():
            image = self._camera.grab(1.0)
            if image is not None:
                self._queue(image)

    def _queue(self, image: CameraImage) -> None:
        delay_s = self._rng.uniform(*self._driver.stamp_delay)
        stamp_ns = image.stamp_ns + round(delay_s * 1e9)
        due_s = stamp_ns * 1e-9 + _TRANSPORT_S
        self._due.append((due_s, stamp_ns, image.image))

    def _publish_due(self) -> None:
        while self._due and self._due[0][0] <= time.time():
            _, stamp_ns, gray = self._due.popleft()
            message = image_message(gray, self._driver.encoding, stamp_ns)
            height, width = gray.shape
            info = camera_info(self._calibration, width, height)
            info.header = header(stamp_ns, 'camera_optical_frame')
            self._count += 1
            repeats = self._driver.repeats
            for _ in range(1 + bool(repeats and self._count % repeats == 0)):
                self._images.publish(message)
                self._infos.publish(info)


def main() -> None:
    """Publish until SIGINT."""
    rclpy.init()
    folder, driver = sys.argv[1:3]
    node = ForeignCameraNode(Path(folder), driver)
    sys.stdout.write('ready\n')
    sys.stdout.flush()
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(node)


if __name__ == '__main__':
    main()
