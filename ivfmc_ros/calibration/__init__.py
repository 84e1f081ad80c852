# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Calibration of camera, laser planes and turntable from pictures.

``boards`` detects calibration boards and markers, ``camera`` estimates intrinsics and board
poses, ``laser`` the laser planes, ``turntable`` the axis and the table angles. ``nominal`` makes
a first cell from measured lengths; ``report`` and ``figure`` document a result.
"""
