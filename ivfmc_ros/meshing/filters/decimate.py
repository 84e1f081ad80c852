# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Fewer triangles: fast and rough for a display, or within a tolerance for CAD."""

import numpy as np

from ivfmc_ros.meshing.geometry import normals
from ivfmc_ros.meshing.geometry import topology
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Kinds
from ivfmc_ros.model import Mesh
from ivfmc_ros.surface import Surface

_ROUNDS = 6
_LEAST_FACES = 200


def clustered(
    vertices_xyz: Floats, faces: Ints, values: Floats, most: int
) -> tuple[Floats, Ints, Floats]:
    """
    Merge vertices that are near each other, until there are at most ``most`` triangles.

    For display only: the result is not a manifold.

    values : (n,) of the vertices; merged ones have the mean of those that are finite
    """
    size = float(np.ptp(vertices_xyz, axis=0).max(initial=0.0))
    cells = np.sqrt(most) * 0.8
    while len(faces) > most:
        key = np.round((vertices_xyz - vertices_xyz.min(axis=0)) / max(size, 1e-12) * cells)
        key = key.astype(np.int64) @ np.array([1, 1 << 20, 1 << 40])
        _, owner, count = np.unique(key, return_inverse=True, return_counts=True)
        place = np.stack([np.bincount(owner, vertices_xyz[:, k]) for k in range(3)], axis=1)
        there = np.isfinite(values)
        known = np.bincount(owner, there)
        with np.errstate(invalid='ignore', divide='ignore'):
            values = np.bincount(owner, np.where(there, values, 0.0)) / known
        vertices_xyz = place / count[:, None]
        faces = owner[faces]
        faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
        cells *= 0.75
    return vertices_xyz, faces, values


def decimated(mesh: Mesh, tolerance: float) -> tuple[Mesh, float]:
    """
    Simplify a mesh by quadric collapses (Garland & Heckbert 1997), as far as the tolerance lets.

    The true deviation is measured both ways; a step that exceeds the tolerance, or that breaks
    the 2-manifold, is not taken.

    tolerance : metres
    returns : the mesh, and its largest deviation from the given one, metres
    """
    best, error = mesh, 0.0
    target = len(mesh.faces)
    for _ in range(_ROUNDS):
        target //= 2
        if target < _LEAST_FACES:
            break
        smaller = _simplified(mesh, target)
        if smaller is None:
            break
        found = _deviation(mesh, smaller)
        if found > tolerance:
            break
        best, error = smaller, found
    return best, error


def _simplified(mesh: Mesh, target: int) -> Mesh | None:
    import open3d as o3d

    made = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(mesh.vertices_xyz), o3d.utility.Vector3iVector(mesh.faces)
    ).simplify_quadric_decimation(target_number_of_triangles=target)
    vertices = np.asarray(made.vertices, dtype=np.float64)
    faces = np.asarray(made.triangles, dtype=np.int64)
    if not made.is_edge_manifold(allow_boundary_edges=True) or not made.is_vertex_manifold():
        return None
    used, faces = topology.compact(faces, len(vertices))
    vertices = vertices[used]
    if np.isnan(normals.of_faces(vertices, faces)).any():
        return None
    return _with_attributes(mesh, vertices, faces)


def _with_attributes(mesh: Mesh, vertices: Floats, faces: Ints) -> Mesh:
    """Give new vertices and faces what the nearest of the old ones have."""
    near = Surface(mesh.vertices_xyz, mesh.faces)
    corner = mesh.faces[near.nearest(vertices).faces, 0]
    kind: Kinds | None = None
    if mesh.kind is not None:
        kind = mesh.kind[near.nearest(vertices[faces].mean(axis=1)).faces]
    return Mesh(
        vertices_xyz=vertices,
        faces=faces,
        normals=normals.of_vertices(vertices, faces),
        sigma=mesh.sigma[corner],
        intensity=mesh.intensity[corner],
        kind=kind,
        flying=mesh.flying,
    )


def _deviation(mesh: Mesh, smaller: Mesh) -> float:
    there = Surface(smaller.vertices_xyz, smaller.faces).nearest(mesh.vertices_xyz).distance
    middles = smaller.vertices_xyz[smaller.faces].mean(axis=1)
    back = Surface(mesh.vertices_xyz, mesh.faces).nearest(middles).distance
    return float(max(there.max(initial=0.0), back.max(initial=0.0)))
