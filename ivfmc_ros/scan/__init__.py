# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The scan as a job: what was asked for, which sweeps it takes, how far it is."""
