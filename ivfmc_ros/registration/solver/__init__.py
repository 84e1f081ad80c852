# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Multi-view point-to-plane registration with priors.

Views are downsampled, surfels are fitted, and Gauss-Newton over all poses (and, in
self-calibration, the cell's parameters) minimizes the point-to-plane distances of
correspondences. Directions that the data do not constrain stay at the prior.
"""
