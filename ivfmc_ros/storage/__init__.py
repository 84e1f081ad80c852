# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Storage of scans without ROS.

``messages``: ROS 2 messages as CDR bytes; ``bag``: reading and writing of MCAP bags; ``matching``:
table angle and laser of each image; ``recording``: production of bags; ``catalogue``: database of
scans; ``scans``: reading of recorded scans.
"""
