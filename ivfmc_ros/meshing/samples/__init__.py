# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Oriented, weighted surface samples from views and their poses.

Views become range grids with viewing geometry; uncertain points at stripe ends are projected onto
the surface around them or dropped; the rest become ``SurfaceSamples`` with normals and weights.
"""
