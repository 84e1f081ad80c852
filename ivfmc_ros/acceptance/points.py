# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The point set of an acceptance test: measured vertices of a scanned mesh."""

import numpy as np

from ivfmc_ros.model import Floats
from ivfmc_ros.model import MEASURED
from ivfmc_ros.model import Mesh


def measured_points(mesh: Mesh) -> tuple[Floats, Floats]:
    """
    Return points and normals, (n, 3), of the vertices that are measured.

    Vertices of faces that bridge a gap or fill a hole are computed, not measured.
    """
    used = np.zeros(len(mesh.vertices_xyz), dtype=bool)
    used[mesh.faces.ravel()] = True
    if mesh.kind is not None:
        used[mesh.faces[mesh.kind != MEASURED].ravel()] = False
    used &= np.isfinite(mesh.normals).all(axis=1)
    return mesh.vertices_xyz[used], mesh.normals[used]
