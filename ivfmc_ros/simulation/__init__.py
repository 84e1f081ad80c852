# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A cell without hardware: rendered stripes and boards, with their ground truth."""
