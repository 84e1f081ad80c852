# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Meshing: views and their poses to one triangle mesh, and to mesh files.

``build.build_mesh`` is the entry point. It offers three methods: ``integrate`` (signed distance
on voxels, the default), ``paper`` (Ismail et al. 2007) and ``poisson`` (for comparison).
``io.export`` writes the result.
"""
