# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From a picture of the stripe to points on the part: extract, triangulate, denoise."""
