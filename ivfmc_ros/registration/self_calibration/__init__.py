# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Self-calibration: a scan corrects the axis, table angle and laser planes of its cell.

The points of a scan are functions of pixel, table angle and cell. The cell's parameters are
estimated together with the view poses by the solver, with the calibration as a prior.
"""
