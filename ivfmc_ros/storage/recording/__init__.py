# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Production of bags.

``LiveRecorder`` records the messages of a running scan, ``import_images_as_bag`` writes image
files with their table angles.
"""

from ivfmc_ros.storage.recording.image_import import import_images_as_bag as import_images_as_bag
from ivfmc_ros.storage.recording.live_recorder import LiveRecorder as LiveRecorder
from ivfmc_ros.storage.recording.profile_location import ProfileLocation as ProfileLocation
