# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Drivers of hardware behind small protocols.

``controller`` is the protocol of a motion controller (table and lasers), which ``grbl``,
``marlin`` and ``fabscan`` implement and ``any_controller`` chooses from; ``cameras`` holds the
protocol of a camera and its drivers; ``turntable`` joins a controller with the laser interlock of
``beam`` and the ``guard`` process.
"""

from ivfmc_ros.devices.beam import BeamInterlock as BeamInterlock
from ivfmc_ros.devices.beam import BeamSettings as BeamSettings
from ivfmc_ros.devices.controller import ControllerState as ControllerState
from ivfmc_ros.devices.controller import MotionController as MotionController
from ivfmc_ros.devices.turntable import TurntableDriver as TurntableDriver
