# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated cell in real time: its folder, true motion and laser power, and the camera."""

from ivfmc_ros.simulation.live.camera import SimulatedCamera as SimulatedCamera
from ivfmc_ros.simulation.live.folder import LiveDescription as LiveDescription
from ivfmc_ros.simulation.live.folder import LiveFolder as LiveFolder
