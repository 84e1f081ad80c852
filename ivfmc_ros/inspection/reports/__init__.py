# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reports of scans and inspections: ``report.json``, ``report.html`` and rendered images."""
