# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Care of recorded scans: rows from bags (``rebuild``), ``trash``, exchange as ``packages``."""
