# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Thin ROS 2 nodes, one file each, and the conversions between arrays and messages."""
