# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Decimation of a mesh within a tolerance, by quadric edge collapse (Garland & Heckbert 1997).

Flat regions become few triangles, edges and curved regions keep theirs. An edge is collapsed
while the sum of the squared distances to the planes of all triangles that it replaces is below the
square of the tolerance. The faces of each kind (measured, bridged, ...) are decimated by
themselves, and their borders keep all vertices: no face covers what it was not measured from.
"""

from dataclasses import dataclass
import math

import numpy as np
from scipy.spatial import cKDTree

from ivfmc_ros.meshing.geometry import normals
from ivfmc_ros.meshing.geometry import topology
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Kinds
from ivfmc_ros.model import Mesh
from ivfmc_ros.surface import Surface

# The error of the library is a sum over planes: the greatest distance is about 0.6 of its root.
# The first attempt has this limit, in tolerances; the next half of it where the result is no sound
# mesh or too far from the full one, or twice of it where it is near and has too many faces.
_FIRST_LIMIT, _MAX_ATTEMPTS = 1.5, 3
# First limit where ``enough`` faces will do: vertices stay about a point spacing apart, so that
# each carries the sigma of its place (demo part: 99 % of the edges below 1.1 mm, not 1.6 mm).
_GENTLE_LIMIT = 0.5
# Share of the tolerance below which a result is near.
_NEAR = 0.5
# Meters; vertices of a border that came back from the library are this near to what they were.
_SAME_PLACE = 1e-9
# Meshes and parts of one kind with fewer faces stay as they are.
_MIN_FACES = 200
# The library collapses edges whose error (a squared distance) is below the epsilon of float64; the
# mesh is scaled so that this is the square of the tolerance.
_LIBRARY_LIMIT = math.sqrt(np.finfo(np.float64).eps)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Triangles:
    """Vertices (n, 3), faces (m, 3) and the kind (m,) of each face."""

    vertices_xyz: Floats
    faces: Ints
    kind: Kinds


def decimate(mesh: Mesh, tolerance: float, enough: int = 0) -> tuple[Mesh, float]:
    """
    Decimate a mesh as far as the tolerance allows.

    The deviation is measured in both directions. A result that exceeds the tolerance, or that is
    no 2-manifold, is discarded.

    tolerance : meters
    enough : number of faces that will do, so that the attempts begin with a small part of the
        tolerance and end there; 0 for as few faces as the tolerance allows
    returns : the decimated mesh, and its largest deviation from ``mesh``, meters; the given mesh
        and 0.0 where nothing can be decimated
    """
    if len(mesh.faces) < max(_MIN_FACES, enough) or not tolerance > 0.0:
        return mesh, 0.0
    best, error = None, 0.0
    limit = (_GENTLE_LIMIT if enough else _FIRST_LIMIT) * tolerance
    for _ in range(_MAX_ATTEMPTS):
        made = _collapsed(mesh, limit)
        if len(made.faces) >= len(mesh.faces):
            break
        deviation = _deviation(mesh, made) if _is_sound(made) else math.inf
        if deviation <= tolerance:
            best, error = made, deviation
            if len(made.faces) <= enough or deviation > _NEAR * tolerance:
                break
            limit *= 2.0
        elif best is not None:
            break
        else:
            limit /= 2.0
    return (mesh, 0.0) if best is None else (_with_attributes(mesh, best, error), error)


def _collapsed(mesh: Mesh, tolerance: float) -> _Triangles:
    """Return the faces of all kinds, each decimated by itself, joined at their common borders."""
    scale = _LIBRARY_LIMIT / tolerance
    kind = np.zeros(len(mesh.faces), dtype=np.uint8) if mesh.kind is None else mesh.kind
    vertices, faces, kinds = [], [], []
    count = 0
    for one in np.unique(kind):
        used, local = topology.compact_vertices(mesh.faces[kind == one], len(mesh.vertices_xyz))
        given = mesh.vertices_xyz[used]
        border = given[np.unique(topology.boundary_edges(local))]
        corners, local = _simplified(given * scale, local)
        vertices.append(_restored(corners / scale, border))
        faces.append(local + count)
        kinds.append(np.full(len(local), one, dtype=np.uint8))
        count += len(corners)
    merged, number = np.unique(np.concatenate(vertices), axis=0, return_inverse=True)
    return _Triangles(
        vertices_xyz=merged,
        faces=number.reshape(-1)[np.concatenate(faces)],
        kind=np.concatenate(kinds),
    )


def _simplified(vertices: Floats, faces: Ints) -> tuple[Floats, Ints]:
    """Collapse the edges of triangles, but for those at an open border, below the limit."""
    if len(faces) < _MIN_FACES:
        return vertices, faces
    import fast_simplification

    made, faces = fast_simplification.simplify(
        vertices, faces.astype(np.int32), lossless=True, preserve_border=True
    )
    return np.asarray(made, dtype=np.float64), np.asarray(faces, dtype=np.int64)


def _restored(vertices: Floats, border: Floats) -> Floats:
    """Return the vertices; those at a border, which rounding has moved, as they were."""
    if len(border):
        distance, nearest = cKDTree(border).query(vertices, distance_upper_bound=_SAME_PLACE)
        kept = np.isfinite(distance)
        vertices[kept] = border[nearest[kept]]
    return vertices


def _is_sound(made: _Triangles) -> bool:
    """Return whether the faces are a 2-manifold without faces of no area."""
    faces = made.faces
    if not len(faces) or np.isnan(normals.face_normals(made.vertices_xyz, faces)).any():
        return False
    count = len(made.vertices_xyz)
    following = np.roll(faces, -1, axis=1)
    # a directed edge belongs to one face
    key = np.sort((faces * count + following).ravel())
    if (key[1:] == key[:-1]).any():
        return False
    manifold: Bools = topology.faces_without_bow_ties(faces, count)
    return bool(manifold.all())


def _with_attributes(mesh: Mesh, made: _Triangles, deviation: float) -> Mesh:
    """Return the mesh of the new faces with the attributes of the nearest old vertices."""
    _, nearest = cKDTree(mesh.vertices_xyz, balanced_tree=False).query(made.vertices_xyz)
    return Mesh(
        vertices_xyz=made.vertices_xyz,
        faces=made.faces,
        normals=normals.vertex_normals(made.vertices_xyz, made.faces),
        sigma=mesh.sigma[nearest],
        intensity=mesh.intensity[nearest],
        kind=None if mesh.kind is None else made.kind,
        systematic=None if mesh.systematic is None else mesh.systematic[nearest],
        isolated_components=mesh.isolated_components,
        decimation_deviation=deviation,
    )


def _deviation(mesh: Mesh, made: _Triangles) -> float:
    """Return the largest distance (meters) of vertices and face centers to the other mesh."""
    forward = Surface(made.vertices_xyz, made.faces).nearest(mesh.vertices_xyz).distance
    centers = made.vertices_xyz[made.faces].mean(axis=1)
    backward = Surface(mesh.vertices_xyz, mesh.faces).nearest(centers).distance
    return float(max(forward.max(initial=0.0), backward.max(initial=0.0)))
