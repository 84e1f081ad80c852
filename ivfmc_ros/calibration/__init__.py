# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From pictures of boards, stripes and markers to a calibrated cell."""
