# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
ROS 2 nodes: one file per executable, thin shells over the ROS-free core.

A node declares parameters, converts messages, calls the core, and publishes.

framework : base classes, parameters, QoS, diagnostics, services
convert : arrays to messages and back
processing : shared parts of triangulator, registrar and mesher
scanning : parts of the orchestrator

Each node starts as ``python -m ivfmc_ros.nodes.<name>`` or ``ros2 run ivfmc_ros <name>``.
"""
