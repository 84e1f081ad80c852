# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From views and their poses to one triangle mesh, and to files that CAD reads."""
