# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rendered pictures of calibration boards, held in the hand or lying on the platter."""
