# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Laser planes from pictures of a board with the laser stripe on it.

The stripe is extracted where it lies on white paper, triangulated with the pose of the board,
and a plane (with a bow where it is significant) is fitted to the points of all pictures.
"""
