# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Topology and normals of triangle and quadrilateral meshes, as functions on plain arrays."""
