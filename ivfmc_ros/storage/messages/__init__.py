# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Conversion between ROS 2 messages, as CDR bytes or objects, and the types of ``model``."""
