# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Matching of camera images with table positions and laser states by stamps.

``FrameMatcher`` serves bags and live messages alike; ``JointHistory`` and ``LaserHistory`` store
the states over time.
"""

from ivfmc_ros.storage.matching.frame_matching import DarkFrame as DarkFrame
from ivfmc_ros.storage.matching.frame_matching import FrameMatch as FrameMatch
from ivfmc_ros.storage.matching.frame_matching import FrameMatcher as FrameMatcher
from ivfmc_ros.storage.matching.frame_matching import MatchSettings as MatchSettings
from ivfmc_ros.storage.matching.joint_history import JointHistory as JointHistory
from ivfmc_ros.storage.matching.laser_history import LaserHistory as LaserHistory
