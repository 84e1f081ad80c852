# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Acceptance and reverification test of a cell with a calibrated artifact (VDI/VDE 2634-3).

``find_spheres`` and ``find_planes`` separate the artifact from the rest of a scan, ``check``
measures and judges it, ``certificate`` and ``record`` write the result, ``state`` says whether it
still counts.
"""
