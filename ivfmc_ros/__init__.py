# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Camera, line laser and turntable as a measuring 3-D scanner."""

__version__ = '0.1.0'
