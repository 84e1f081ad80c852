# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Cameras: the protocol ``CameraDevice``, and drivers for OpenCV and for folders of images.

``Capture`` runs any of them in a thread and opens it again when it is lost.
"""

from ivfmc_ros.devices.cameras.capture import Capture as Capture
from ivfmc_ros.devices.cameras.device import CameraDevice as CameraDevice
from ivfmc_ros.devices.cameras.device import CameraImage as CameraImage
from ivfmc_ros.devices.cameras.device import Exposure as Exposure
from ivfmc_ros.devices.cameras.folder import FolderCamera as FolderCamera
from ivfmc_ros.devices.cameras.opencv import OpencvCamera as OpencvCamera
