# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The work window: a page in a browser that shows a cell, its scans and their meshes. No ROS.

``page`` puts tabs and 3-D scene together, by the library viser, whose server listens on a port of
the loopback interface that nothing else knows. Browsers connect to ``gate``, which lets in who has
the token, and forwards them. The node ``window`` hands over what it receives; ``ivfmc view`` shows
files in the same scene.
"""
