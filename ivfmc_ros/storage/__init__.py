# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scans on disk: bags that every ROS 2 tool plays, written and read without ROS."""
