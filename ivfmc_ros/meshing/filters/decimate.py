# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Decimation of a mesh within a tolerance, by quadric edge collapse (Garland & Heckbert 1997)."""

import numpy as np

from ivfmc_ros.meshing.geometry import normals
from ivfmc_ros.meshing.geometry import topology
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Kinds
from ivfmc_ros.model import Mesh
from ivfmc_ros.surface import Surface

# Each step halves the number of triangles, so six steps leave 1/64 of them.
_MAX_STEPS = 6
_MIN_FACES = 200


def decimate(mesh: Mesh, tolerance: float) -> tuple[Mesh, float]:
    """
    Decimate a mesh by quadric edge collapse as far as the tolerance allows.

    The deviation is measured in both directions. A step that exceeds the tolerance, or whose
    result is no 2-manifold, is discarded, and the previous result is returned.

    tolerance : meters
    returns : the decimated mesh, and its largest deviation from ``mesh``, meters
    """
    best, error = mesh, 0.0
    target = len(mesh.faces)
    for _ in range(_MAX_STEPS):
        target //= 2
        if target < _MIN_FACES:
            break
        smaller = _simplified(mesh, target)
        if smaller is None:
            break
        deviation = _deviation(mesh, smaller)
        if deviation > tolerance:
            break
        best, error = smaller, deviation
    return best, error


def _simplified(mesh: Mesh, target: int) -> Mesh | None:
    """Return the mesh with about ``target`` triangles; None if it is no sound 2-manifold."""
    import open3d as o3d

    made = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(mesh.vertices_xyz), o3d.utility.Vector3iVector(mesh.faces)
    ).simplify_quadric_decimation(target_number_of_triangles=target)
    vertices = np.asarray(made.vertices, dtype=np.float64)
    faces = np.asarray(made.triangles, dtype=np.int64)
    if not made.is_edge_manifold(allow_boundary_edges=True) or not made.is_vertex_manifold():
        return None
    used, faces = topology.compact_vertices(faces, len(vertices))
    vertices = vertices[used]
    if np.isnan(normals.face_normals(vertices, faces)).any():
        return None
    return _with_attributes(mesh, vertices, faces)


def _with_attributes(mesh: Mesh, vertices: Floats, faces: Ints) -> Mesh:
    """Return a mesh of new vertices and faces with the attributes of the nearest old ones."""
    surface = Surface(mesh.vertices_xyz, mesh.faces)
    corner = mesh.faces[surface.nearest(vertices).faces, 0]
    kind: Kinds | None = None
    if mesh.kind is not None:
        kind = mesh.kind[surface.nearest(vertices[faces].mean(axis=1)).faces]
    return Mesh(
        vertices_xyz=vertices,
        faces=faces,
        normals=normals.vertex_normals(vertices, faces),
        sigma=mesh.sigma[corner],
        intensity=mesh.intensity[corner],
        kind=kind,
        isolated_components=mesh.isolated_components,
    )


def _deviation(mesh: Mesh, smaller: Mesh) -> float:
    """Return the largest distance (meters) of vertices and face centers to the other mesh."""
    forward = Surface(smaller.vertices_xyz, smaller.faces).nearest(mesh.vertices_xyz).distance
    centers = smaller.vertices_xyz[smaller.faces].mean(axis=1)
    backward = Surface(mesh.vertices_xyz, mesh.faces).nearest(centers).distance
    return float(max(forward.max(initial=0.0), backward.max(initial=0.0)))
