# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the commands share: options, output, client of a cell, its processes."""
