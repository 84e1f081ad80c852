# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Joint calibration: one adjustment of camera, laser planes and turntable axis to all pictures.

Boards, stripes on boards, targets on the platter and stripes on the platter are observations of
one model (bundle adjustment: Triggs et al. 2000). The separate steps give the initial values.
"""
