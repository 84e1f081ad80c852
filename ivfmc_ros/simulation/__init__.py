# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Simulation of a cell with ground truth.

``bench`` is the cell, ``parts`` what stands on its table, ``render`` and ``boards`` make images;
``grbl``, ``marlin``, ``fabscan``, ``controller_emulator``, ``live`` and ``live_cell`` simulate the
hardware in real time.
"""

from ivfmc_ros.simulation.bench import bench_cell as bench_cell
