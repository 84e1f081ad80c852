# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Views from profiles: organized point clouds, and the table angles of a sweep."""
