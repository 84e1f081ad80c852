# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Guidance while calibration pictures are taken: what a picture lacks, and what the set lacks.

``picture`` judges one picture (sharpness, exposure, size of the board), ``guide`` the set (places,
tilts, distances), so that a bad set is mended before the board is put away.
"""
