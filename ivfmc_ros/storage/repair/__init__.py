# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Checks recordings (``check_recording``) and repairs damaged ones (``repair_recording``)."""

from ivfmc_ros.storage.repair.check import check_recording as check_recording
from ivfmc_ros.storage.repair.check import RecordingCheck as RecordingCheck
from ivfmc_ros.storage.repair.repair import repair_recording as repair_recording
from ivfmc_ros.storage.repair.repair import RepairedRecording as RepairedRecording
