# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Solids to scan: STL files, a machined demo part, and simple shapes; the platter."""
