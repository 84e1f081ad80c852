# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Truncated signed distance on sparse blocks of voxels, and its zero surface.

Surface samples are accumulated (``signed_distance``), free space is carved, holes are filled on a
coarse grid, and the closed distance becomes quads by surface nets.
"""
