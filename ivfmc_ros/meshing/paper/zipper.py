# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Views joined to one mesh: where surfaces overlap, one of them is redundant and goes."""

from collections.abc import Iterable

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.meshing.geometry import normals
from ivfmc_ros.meshing.paper.range_mesh import range_mesh
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Mesh
from ivfmc_ros.model import Poses
from ivfmc_ros.model import View
from ivfmc_ros.surface import Surface

# Two surfaces nearer than the reach are the same one only if their normals agree (60 degrees):
# the two sides of a thin wall are not.
_SAME_SIDE = 0.5


def join_views(cell: Cell, views: Iterable[View], poses: Poses, max_edge: float) -> Mesh:
    """
    Triangulate every view and join them.

    A stripe runs over the axis, so a top face is measured twice in one sweep, once on either
    side of the axis: each side of each view is a patch of its own. Patches are added in turn
    without the faces that lie on what is there.

    max_edge : metres
    returns : Mesh in ``turntable``
    :raises GeometryError: no view has a triangle
    """
    views = list(views)
    patches = []
    for side in (True, False):
        for view, T in zip(views, poses.turntable_from_view, strict=True):
            chosen = _laser_side(cell, view) == side
            patches.append(_moved(range_mesh(cell, view, max_edge, chosen), T))
    patches = [patch for patch in patches if len(patch.faces)]
    if not patches:
        raise GeometryError(
            f'meshing: no three neighbouring points lie within {max_edge * 1e3:.2f} mm; '
            'raise max_edge or scan in finer steps'
        )
    whole = patches[0]
    for patch in patches[1:]:
        whole = _concatenate(whole, without_redundant(patch, whole, 0.5 * max_edge))
    return whole


def without_redundant(patch: Mesh, known: Mesh, reach: float) -> Mesh:
    """
    Return the patch without the faces that lie on ``known``.

    reach : metres; a vertex this near to a face of ``known`` that faces the same way is redundant
    """
    found = Surface(known.vertices_xyz, known.faces).nearest(patch.vertices_xyz)
    agree = (found.normals * patch.normals).sum(axis=1) > _SAME_SIDE
    redundant: Bools = (found.distance < reach) & agree
    return _with_faces(patch, patch.faces[~redundant[patch.faces].all(axis=1)])


def _laser_side(cell: Cell, view: View) -> Bools:
    """Tell of every point whether the stripe was on the camera's side of the axis."""
    R = cell.turntable.camera_from_base[:3, :3]
    normal = R.T @ cell.lasers[view.laser].normal
    along = np.cross([0.0, 0.0, 1.0], normal)
    # x of turntable_base points to the camera
    along *= np.copysign(1.0, along[0])
    in_part = (along @ transforms.rotation_z(view.angles))[None]
    with np.errstate(invalid='ignore'):
        return np.asarray((view.points_xyz * in_part).sum(axis=2) >= 0.0)


def _moved(mesh: Mesh, T: Floats) -> Mesh:
    return Mesh(
        vertices_xyz=transforms.apply(T, mesh.vertices_xyz),
        faces=mesh.faces,
        normals=mesh.normals @ T[:3, :3].T,
        sigma=mesh.sigma,
        intensity=mesh.intensity,
    )


def _with_faces(mesh: Mesh, faces: Ints) -> Mesh:
    """Return the mesh with other faces over its vertices, without those left unused."""
    used, faces = np.unique(faces, return_inverse=True)
    return Mesh(
        vertices_xyz=mesh.vertices_xyz[used],
        faces=faces.reshape(-1, 3),
        normals=mesh.normals[used],
        sigma=mesh.sigma[used],
        intensity=mesh.intensity[used],
    )


def _concatenate(a: Mesh, b: Mesh) -> Mesh:
    vertices = np.concatenate([a.vertices_xyz, b.vertices_xyz])
    faces = np.concatenate([a.faces, b.faces + len(a.vertices_xyz)])
    return Mesh(
        vertices_xyz=vertices,
        faces=faces,
        normals=normals.of_vertices(vertices, faces),
        sigma=np.concatenate([a.sigma, b.sigma]),
        intensity=np.concatenate([a.intensity, b.intensity]),
    )
