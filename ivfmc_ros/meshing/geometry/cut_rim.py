# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rim of a mesh where the working volume cut the surface, not where the part or the scan ends."""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.cell.volume import Volume
from ivfmc_ros.meshing.geometry.topology import boundary_edges
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Mesh

# A rim ends up to so many edges inside of the volume: its last points have no neighbors beyond.
_MAX_EDGES = 3.0


@dataclass(frozen=True, eq=False, kw_only=True)
class CutRim:
    """
    Boundary edges at the limits of the working volume.

    vertices : (n,) indices of the vertices of these edges, ascending
    radius, top : meters, length of the edges at the radius and at the top
    """

    vertices: Ints
    radius: float
    top: float


def find_cut_rim(mesh: Mesh, volume: Volume) -> CutRim:
    """
    Return the boundary edges whose vertices lie at the radius or the top of the volume.

    mesh : in ``turntable``, whose axis is that of the volume
    """
    edges = boundary_edges(mesh.faces)
    if not len(edges):
        return CutRim(vertices=np.zeros(0, dtype=np.int64), radius=0.0, top=0.0)
    ends = mesh.vertices_xyz[edges]
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    limit = _MAX_EDGES * float(np.median(lengths))
    at_radius = (np.hypot(ends[..., 0], ends[..., 1]) > volume.radius - limit).all(axis=1)
    at_top = (ends[..., 2] > volume.top - limit).all(axis=1) & ~at_radius
    return CutRim(
        vertices=np.unique(edges[at_radius | at_top]),
        radius=float(lengths[at_radius].sum()),
        top=float(lengths[at_top].sum()),
    )


def rim_figures(mesh: Mesh, volume: Volume) -> dict[str, float]:
    """Return the length of the rim at each limit of the volume, meters, for a report."""
    rim = find_cut_rim(mesh, volume)
    return {'radius_m': rim.radius, 'top_m': rim.top, 'vertices': len(rim.vertices)}
