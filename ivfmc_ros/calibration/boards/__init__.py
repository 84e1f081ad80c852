# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Calibration boards and ArUco markers: description, corner detection, shape of a bent board.

Everything is in the frame of the board, in meters; corners are in pixels of the picture.
"""
