# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Laser stripe processing: from an image to a profile of points in the turntable frame.

``acquisition.Acquisition`` runs the steps for one image: ``extract`` (sub-pixel stripe
positions), ``triangulate`` (points) and ``denoise``; ``stream`` does so for the images of a scan.
"""
