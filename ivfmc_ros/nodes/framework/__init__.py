# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Base classes of the nodes and helpers that know nothing about scanning.

``base`` (heartbeat, diagnostics, guarded callbacks, services), ``executor``, ``heartbeats`` (of
other nodes), ``lifecycle``, ``parameters``, ``health`` (conditions), ``qos``,
``adaptive_subscription``, ``futures`` (awaiting in callbacks), ``json_response``,
``service_retry``, ``environment`` (of a node's process; no ROS).
"""
