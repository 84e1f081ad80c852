# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Mesh files: STL, PLY, OBJ, binary glTF and 3MF are written, and own STL files read back."""
