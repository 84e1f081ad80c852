# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Views with noise, flying points and holes, and what a sound mesh of them is."""

from dataclasses import replace

import numpy as np
import open3d as o3d
import trimesh

from ivfmc_ros.model import Mesh
from ivfmc_ros.model import View
from ivfmc_ros.registration.views.assemble import assemble
from ivfmc_ros.registration.views.assemble import without
from support.synthetic import small_cell
from support.synthetic import Sphere
from support.synthetic import sphere_profiles

CELL = small_cell()
SPHERE = Sphere(np.array([0.004, 0.002, 0.03]), 0.025)


def views(count: int = 2, steps: int = 90) -> list[View]:
    """Return sweeps of a sphere, one for each laser."""
    return [
        assemble(CELL, sphere_profiles(CELL, SPHERE, steps, laser=k, view=k))[0]
        for k in range(count)
    ]


def spoilt(view: View, seed: int) -> View:
    """Add noise and single points that fly, and cut holes."""
    rng = np.random.default_rng(seed)
    noise = rng.normal(scale=0.04e-3, size=view.points_xyz.shape)
    flying = rng.random(view.valid.shape) < 0.002
    noise[flying] += rng.normal(scale=1.5e-3, size=(int(flying.sum()), 3))
    rows, columns = np.indices(view.valid.shape)
    gone = rng.random(view.valid.shape) < 0.03
    for _ in range(4):
        row, column = rng.integers(0, view.valid.shape[0]), rng.integers(0, view.valid.shape[1])
        gone |= (np.abs(rows - row) < 25) & (np.abs(columns - column) < 4)
    return without(replace(view, points_xyz=view.points_xyz + noise), gone & view.valid)


def unsound(mesh: Mesh, *, closed: bool) -> list[str]:
    """Name what keeps a mesh from being a sound, closed or open, surface, judged by libraries."""
    legacy = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(mesh.vertices_xyz), o3d.utility.Vector3iVector(mesh.faces)
    )
    read = trimesh.Trimesh(mesh.vertices_xyz * 1e3, mesh.faces, process=False)
    wrong = {
        'edges': not legacy.is_edge_manifold(allow_boundary_edges=not closed),
        'vertices': not legacy.is_vertex_manifold(),
        'orientation': not (legacy.is_orientable() and read.is_winding_consistent),
        'watertight': read.is_watertight is not closed,
        'degenerate': not read.area_faces.min() > 1e-9,
        'intersections': len(legacy.get_self_intersecting_triangles()) > 0,
    }
    return [name for name, is_wrong in wrong.items() if is_wrong]
