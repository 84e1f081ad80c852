# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Camera intrinsics and board poses from board corners, by bundle adjustment (Zhang 2000)."""
