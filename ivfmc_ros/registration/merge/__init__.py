# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Registration of several clampings of one part to each other, without an initial pose.

``merge.merge`` takes registered scans and returns their views and poses in one frame. The pose of
each scan is found by point pair features, coarse ICP and point-to-plane registration
(``pose_search``), and checked for contradicting surface and for symmetry (``pose_evidence``).
"""
