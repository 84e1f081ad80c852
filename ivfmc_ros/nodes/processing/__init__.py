# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What the processing nodes (triangulator, registrar, mesher) are built from.

The calibrated cell from files and ``camera_info``, the parameters and the debug image of the
triangulator, and the long jobs that registrar and mesher run in a child process.
"""
