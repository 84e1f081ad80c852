# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Programs to copy: a client of the scan service, and batch processing of recorded scans."""
