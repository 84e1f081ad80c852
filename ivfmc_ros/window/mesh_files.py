# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Meshes of files for the 3-D view: uncertainty, texture, distance to a nominal or a mesh."""

from pathlib import Path

import numpy as np
import open3d as o3d
from scipy.spatial import cKDTree

from ivfmc_ros.inspection.mesh_file import MeshBody
from ivfmc_ros.inspection.mesh_file import read_mesh
from ivfmc_ros.model import Floats
from ivfmc_ros.surface import Surface
from ivfmc_ros.window.drawn import DEVIATION
from ivfmc_ros.window.drawn import DrawnMesh
from ivfmc_ros.window.drawn import SIGMA
from ivfmc_ros.window.drawn import TEXTURE
from ivfmc_ros.window.placed_nominal import PlacedNominal

# Faces beyond which a mesh is thinned for the browser, and the cells of that along its diagonal.
_MAX_FACES = 400_000
_CELLS = 450


def load_mesh(path: Path, unit: str, nominal: PlacedNominal | None = None) -> DrawnMesh:
    """
    Read a mesh for display.

    unit : of its coordinates: m, mm or inch
    nominal : to compare it with; None for none
    :raises ScanError: the file cannot be read (``inspection.mesh_file.read_mesh``)
    """
    body = read_mesh(path, unit)
    values = {SIGMA: body.sigma, TEXTURE: body.gray}
    if nominal is not None:
        values[DEVIATION] = _deviations(body, nominal)
    known = {name: value for name, value in values.items() if value is not None}
    return _thinned(body, known, None if nominal is None else nominal.tolerance)


def _deviations(body: MeshBody, nominal: PlacedNominal) -> Floats:
    """Return (n,) meters; NaN at vertices that were not measured, as in an inspection."""
    deviations = nominal.deviations(body.vertices_xyz)
    if body.sigma is not None and np.isfinite(body.sigma).any():
        deviations[~np.isfinite(body.sigma)] = np.nan
    return deviations


def compare(path: Path, unit: str, other: Path, other_unit: str) -> DrawnMesh:
    """
    Read a mesh, and color it by its distance from another one in the same frame.

    The distance is that to the nearest point of ``other``, positive outside of it, in meters.

    :raises ScanError: a file cannot be read
    """
    body, nominal = read_mesh(path, unit), read_mesh(other, other_unit)
    found = Surface(nominal.vertices_xyz, nominal.faces).nearest(body.vertices_xyz)
    outward = np.einsum('ij,ij->i', body.vertices_xyz - found.points_xyz, found.normals)
    values = {DEVIATION: np.copysign(found.distance, outward)}
    if body.gray is not None:
        values[TEXTURE] = body.gray
    return _thinned(body, values)


def _thinned(
    body: MeshBody, values: dict[str, Floats], tolerance: float | None = None
) -> DrawnMesh:
    """Return a mesh that a browser can draw; vertices are merged where there are too many."""
    if len(body.faces) <= _MAX_FACES:
        return DrawnMesh(
            vertices_xyz=body.vertices_xyz, faces=body.faces, values=values, tolerance=tolerance
        )
    whole = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(body.vertices_xyz), o3d.utility.Vector3iVector(body.faces)
    )
    small = whole.simplify_vertex_clustering(body.diagonal / _CELLS)
    vertices = np.asarray(small.vertices, dtype=np.float64)
    _, nearest = cKDTree(body.vertices_xyz).query(vertices)
    return DrawnMesh(
        vertices_xyz=vertices,
        faces=np.asarray(small.triangles, dtype=np.int64),
        values={name: value[nearest] for name, value in values.items()},
        tolerance=tolerance,
    )
