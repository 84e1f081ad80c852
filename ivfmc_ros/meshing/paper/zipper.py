# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Merging of range meshes without their redundant overlap, as in zippering (Turk & Levoy 1994)."""

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

# Nearby surfaces overlap only if their normals agree (cosine; 60 degrees): the two sides of a
# thin wall do not.
_MIN_NORMAL_COSINE = 0.5


def zipper_views(cell: Cell, views: Iterable[View], poses: Poses, max_edge: float) -> Mesh:
    """
    Triangulate every view and merge the range meshes.

    A stripe crosses the turntable axis, so that a top face is measured twice in one sweep, once
    on either side of the axis. Each side of each view is therefore a range mesh of its own. Range
    meshes are added one after another, without the faces that overlap with the previous ones.

    max_edge : meters
    returns : Mesh in ``turntable``
    :raises GeometryError: no view has a triangle
    """
    views = list(views)
    meshes = []
    for camera_side in (True, False):
        for view, T in zip(views, poses.turntable_from_view, strict=True):
            chosen = _on_camera_side(cell, view) == camera_side
            meshes.append(_transformed(range_mesh(cell, view, max_edge, chosen), T))
    meshes = [mesh for mesh in meshes if len(mesh.faces)]
    if not meshes:
        raise GeometryError(
            f'meshing: no three neighboring points lie within {max_edge * 1e3:.2f} mm; '
            'raise max_edge or scan in finer steps'
        )
    whole = meshes[0]
    for mesh in meshes[1:]:
        whole = _concatenate(whole, remove_redundant(mesh, whole, 0.5 * max_edge))
    return whole


def remove_redundant(mesh: Mesh, known: Mesh, max_distance: float) -> Mesh:
    """
    Return a mesh without the faces that overlap with ``known``.

    max_distance : meters; a vertex this near to a face of ``known`` with the same orientation is
        redundant, and a face if all of its vertices are
    """
    found = Surface(known.vertices_xyz, known.faces).nearest(mesh.vertices_xyz)
    agree = (found.normals * mesh.normals).sum(axis=1) > _MIN_NORMAL_COSINE
    redundant: Bools = (found.distance < max_distance) & agree
    return _with_faces(mesh, mesh.faces[~redundant[mesh.faces].all(axis=1)])


def _on_camera_side(cell: Cell, view: View) -> Bools:
    """Return (rows, columns) bool, which points were on the camera's side of the axis."""
    R = cell.turntable.camera_from_base[:3, :3]
    normal = R.T @ cell.lasers[view.laser].normal
    along = np.cross([0.0, 0.0, 1.0], normal)
    # x of turntable_base points to the camera
    along *= np.copysign(1.0, along[0])
    in_part = (along @ transforms.rotation_z(view.angles))[None]
    with np.errstate(invalid='ignore'):
        return np.asarray((view.points_xyz * in_part).sum(axis=2) >= 0.0)


def _transformed(mesh: Mesh, T: Floats) -> Mesh:
    return Mesh(
        vertices_xyz=transforms.apply(T, mesh.vertices_xyz),
        faces=mesh.faces,
        normals=mesh.normals @ T[:3, :3].T,
        sigma=mesh.sigma,
        intensity=mesh.intensity,
    )


def _with_faces(mesh: Mesh, faces: Ints) -> Mesh:
    """Return the mesh with other faces over its vertices, without unused vertices."""
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
        normals=normals.vertex_normals(vertices, faces),
        sigma=np.concatenate([a.sigma, b.sigma]),
        intensity=np.concatenate([a.intensity, b.intensity]),
    )
