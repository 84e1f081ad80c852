# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Rendering of the laser stripe on a part on the turntable, with exact ground truth.

``renderer`` makes camera frames by ray casting (open3d), ``stripe_truth`` computes where the
stripe is from the triangles, ``optics`` models the light and the noise of the sensor.
"""
