# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Views of a sphere with noise, outliers and holes, and a check for defects of meshes."""

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


def degrade(view: View, seed: int) -> View:
    """Return the view with noise, single outliers and holes."""
    rng = np.random.default_rng(seed)
    noise = rng.normal(scale=0.04e-3, size=view.points_xyz.shape)
    outlier = rng.random(view.valid.shape) < 0.002
    noise[outlier] += rng.normal(scale=1.5e-3, size=(int(outlier.sum()), 3))
    rows, columns = np.indices(view.valid.shape)
    removed = rng.random(view.valid.shape) < 0.03
    for _ in range(4):
        row, column = rng.integers(0, view.valid.shape[0]), rng.integers(0, view.valid.shape[1])
        removed |= (np.abs(rows - row) < 25) & (np.abs(columns - column) < 4)
    return without(replace(view, points_xyz=view.points_xyz + noise), removed & view.valid)


def mesh_defects(mesh: Mesh, *, closed: bool) -> list[str]:
    """Return the names of the defects that Open3D and trimesh find in a closed or open mesh."""
    legacy = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(mesh.vertices_xyz), o3d.utility.Vector3iVector(mesh.faces)
    )
    read = trimesh.Trimesh(mesh.vertices_xyz * 1e3, mesh.faces, process=False)
    defects = {
        'edges': not legacy.is_edge_manifold(allow_boundary_edges=not closed),
        'vertices': not legacy.is_vertex_manifold(),
        'orientation': not (legacy.is_orientable() and read.is_winding_consistent),
        'watertight': read.is_watertight is not closed,
        'degenerate': not read.area_faces.min() > 1e-9,
        'intersections': len(legacy.get_self_intersecting_triangles()) > 0,
    }
    return [name for name, found in defects.items() if found]
