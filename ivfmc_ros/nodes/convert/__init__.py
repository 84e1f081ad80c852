# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Conversions between the arrays of the core and ROS messages.

Point clouds, images, meshes, view poses and time stamps. Reading a cloud or an image needs no ROS
and is in ``storage.messages``; the modules here re-export it.
"""
