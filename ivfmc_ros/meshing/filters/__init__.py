# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Operations on a finished mesh.

Connected components, bilateral normal denoising, decimation within a tolerance, and vertex
clustering for display.
"""
