# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Vertices that sample the surface of a mesh evenly enough to stand for its area.

A mesh that was decimated has few vertices where it is flat, and those of a mesh from elsewhere may
all lie at its edges, where nothing is judged.
"""

from dataclasses import replace

import numpy as np

from ivfmc_ros.inspection.deviation import Deviation
from ivfmc_ros.inspection.deviation import summarize
from ivfmc_ros.inspection.mesh_file import MeshBody
from ivfmc_ros.meshing.geometry.areas import vertex_areas
from ivfmc_ros.meshing.geometry.subdivision import split_long_edges
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.surface import Surface

# Meters; longer edges are halved. The stripe of 1.4 mm resolves nothing smaller.
_LONGEST = 1.0e-3
# On a great part edges may be longer, so that a few times as many vertices suffice.
_ENOUGH = 500_000


def sampled(mesh: MeshBody) -> MeshBody:
    """Return the mesh with its long edges halved; what is known of vertices is interpolated."""
    area = float(vertex_areas(mesh.vertices_xyz, mesh.faces).sum())
    # a damaged mesh has needles of any length, and of no area
    edges = np.linalg.norm(np.diff(mesh.vertices_xyz[mesh.faces], axis=1), axis=2).sum()
    longest = max(_LONGEST, float(np.sqrt(area / _ENOUGH)), float(edges) / _ENOUGH)
    known = {
        name: values
        for name in ('sigma', 'systematic', 'gray')
        if (values := getattr(mesh, name)) is not None
    }
    columns = np.column_stack([mesh.vertices_xyz, *known.values()])
    columns, faces = split_long_edges(columns, mesh.faces, longest)
    more = dict(zip(known, columns[:, 3:].T, strict=True))
    return replace(mesh, vertices_xyz=np.ascontiguousarray(columns[:, :3]), faces=faces, **more)


def mesh_deviation(vertices_xyz: Floats, faces: Ints, nominal: Surface) -> Deviation:
    """
    Return the statistics of the signed distances of a mesh from a nominal, weighted by its area.

    vertices_xyz : (n, 3) meters, in the frame of the nominal; faces : (m, 3)
    :raises GeometryError: the mesh is empty
    """
    mesh = sampled(MeshBody(vertices_xyz=vertices_xyz, faces=faces, closed=False))
    distances = nominal.signed_distance(mesh.vertices_xyz)
    return summarize(distances, vertex_areas(mesh.vertices_xyz, mesh.faces))
