# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Range mesh of one view: triangles between neighboring points of neighboring profiles."""

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.meshing.geometry import normals
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Mesh
from ivfmc_ros.model import View
from ivfmc_ros.registration.views.assemble import is_full_turn

# A triangle seen at a more oblique angle than this (cosine; 87 degrees) spans a jump.
_MIN_FACING = 0.05


def range_mesh(cell: Cell, view: View, max_edge: float, chosen: Bools | None = None) -> Mesh:
    """
    Triangulate one view on its own grid (Ismail et al. 2007).

    Four neighbors make two triangles, split along the shorter diagonal; three make one. A
    triangle with an edge longer than ``max_edge`` spans a jump and is left out, and so is one
    that the camera could not have seen. The seam of a full turn is closed.

    max_edge : meters
    chosen : (rows, columns) bool, the points to use; None for all
    returns : Mesh in the frame of the view, faces counter-clockwise seen from the camera
    """
    used = view.valid if chosen is None else view.valid & chosen
    rows, columns = used.shape
    index = np.arange(rows * columns).reshape(rows, columns)
    if is_full_turn(view):
        index = np.concatenate([index, index[:, :1]], axis=1)
    points = view.points_xyz.reshape(-1, 3)
    faces = _grid_faces(index, used.ravel(), points)
    corners = points[faces]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    faces = faces[(edges < max_edge).all(axis=1)]
    faces = _orient_to_camera(cell, view, faces)
    return _to_mesh(view, faces)


def _grid_faces(index: Ints, used: Bools, points: Floats) -> Ints:
    """Return (m, 3) point indices of the triangles of all grid cells with 3 or 4 points."""
    # corners of each cell: a d   (rows go down, profiles go right)
    #                       b e
    a, b, d, e = (
        c.ravel() for c in (index[:-1, :-1], index[1:, :-1], index[:-1, 1:], index[1:, 1:])
    )
    with np.errstate(invalid='ignore'):
        ae = ((points[a] - points[e]) ** 2).sum(axis=1)
        bd = ((points[b] - points[d]) ** 2).sum(axis=1)
        # a diagonal needs both of its ends
        split_ae = ((ae <= bd) & used[a] & used[e]) | ~(used[b] & used[d])
    cell = np.stack([a, b, d, e], axis=1)
    along_ae = np.concatenate([cell[split_ae][:, [0, 1, 3]], cell[split_ae][:, [0, 3, 2]]])
    along_bd = np.concatenate([cell[~split_ae][:, [0, 1, 2]], cell[~split_ae][:, [1, 3, 2]]])
    faces = np.concatenate([along_ae, along_bd])
    return np.asarray(faces[used[faces].all(axis=1)])


def _orient_to_camera(cell: Cell, view: View, faces: Ints) -> Ints:
    """
    Orient the faces to the camera and drop those that it sees from behind or edge on.

    All cells of a grid have the same orientation, so that the sum over all faces decides it;
    faces that disagree are folds across a jump.
    """
    if not len(faces):
        return faces
    columns = view.valid.shape[1]
    cameras = cell.turntable.to_part(np.zeros((1, 3)), 0.0) @ _part_rotations(view.angles)
    corners = view.points_xyz.reshape(-1, 3)[faces]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    to_camera = cameras[faces[:, 0] % columns, 0] - corners[:, 0]
    facing = (areas * to_camera).sum(axis=1)
    if facing.sum() < 0:
        faces, facing = faces[:, ::-1], -facing
    lengths = np.linalg.norm(areas, axis=1) * np.linalg.norm(to_camera, axis=1)
    return np.asarray(faces[facing > _MIN_FACING * lengths])


def _part_rotations(angles: Floats) -> Floats:
    """Return (n, 3, 3) that take row vectors from ``turntable_base`` to ``turntable``."""
    return np.asarray(np.swapaxes(transforms.rotation_z(-angles), 1, 2))


def _to_mesh(view: View, faces: Ints) -> Mesh:
    """Return the mesh of the points that faces use."""
    used, faces = np.unique(faces, return_inverse=True)
    faces = faces.reshape(-1, 3)
    vertices = view.points_xyz.reshape(-1, 3)[used]
    return Mesh(
        vertices_xyz=vertices,
        faces=faces,
        normals=normals.vertex_normals(vertices, faces),
        sigma=view.sigma.ravel()[used],
        intensity=view.intensity.ravel()[used],
    )
