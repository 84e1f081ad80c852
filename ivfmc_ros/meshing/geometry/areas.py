# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Areas of a triangle mesh."""

import numpy as np

from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints


def vertex_areas(vertices_xyz: Floats, faces: Ints) -> Floats:
    """Return a third of the area of the faces around each vertex, (n,) square meters."""
    a, b, c = (vertices_xyz[faces[:, index]] for index in range(3))
    third = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6.0
    return np.asarray(np.bincount(faces.ravel(), np.repeat(third, 3), len(vertices_xyz)))
