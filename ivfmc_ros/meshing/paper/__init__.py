# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Method ``paper``: range meshes of single views (Ismail et al. 2007), merged by zippering.

Unlike in Turk & Levoy 1994, redundant faces are removed but boundaries are not stitched.
"""
