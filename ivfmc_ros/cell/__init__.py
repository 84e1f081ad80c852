# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a cell is: camera model, laser planes, table axis, and the files that hold them."""
