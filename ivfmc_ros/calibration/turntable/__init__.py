# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Turntable axis, platter and table angles from pictures of targets on the platter."""
