# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Registration: profiles are assembled into views, and views are aligned with the table as a prior.

``views`` assembles profiles, ``align`` finds the poses of all views, ``self_calibration``
corrects the cell from a scan, ``merge`` aligns clampings, ``solver`` holds the least squares.
"""
