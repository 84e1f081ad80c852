# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Parts of the orchestrator: one scan as a sequence of topics and service calls.

``cell_link`` (what the cell publishes, and the commands to it), ``graph_tools`` (the steps of a
scan), ``running_scan`` (files, catalogue rows, status, answer), ``scan_parameters``.
"""
