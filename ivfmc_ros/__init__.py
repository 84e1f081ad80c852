# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""3-D scanner of a camera, line lasers and a turntable, for ROS 2."""

__version__ = '0.1.0'
