# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The point set of an acceptance test: measured vertices of a scanned mesh."""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.inspection.mesh_file import MeshBody
from ivfmc_ros.meshing.geometry.normals import vertex_normals
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import MEASURED
from ivfmc_ros.model import Mesh

COVERAGE_FACTOR = 2.0  # of expanded uncertainties: 95 %


@dataclass(frozen=True, eq=False, kw_only=True)
class MeasuredPoints:
    """
    Points of an artifact, in ``turntable``.

    points_xyz, normals : (n, 3) meters, and outward unit normals
    systematic : (n,) meters, 1 sigma of the error that neighboring points share, NaN where it is
        unknown; None if the scan states none
    left_out : share of the measured vertices whose own U is too large to judge by
    """

    points_xyz: Floats
    normals: Floats
    systematic: Floats | None = None
    left_out: float = 0.0


def measured_points(mesh: Mesh, max_u: float) -> MeasuredPoints:
    """
    Return the vertices that are measured, and well enough.

    Vertices of faces that bridge a gap or fill a hole are computed, not measured. Where the edge
    of an artifact cuts the stripe, the scan states a large U: such a vertex says nothing about an
    error that is smaller, as in an inspection.

    max_u : meters, greatest expanded uncertainty (k = 2) of a vertex
    """
    used = np.zeros(len(mesh.vertices_xyz), dtype=bool)
    used[mesh.faces.ravel()] = True
    if mesh.kind is not None:
        used[mesh.faces[mesh.kind != MEASURED].ravel()] = False
    used &= np.isfinite(mesh.normals).all(axis=1)
    known = _known_well(mesh.sigma, mesh.systematic, max_u)
    return _chosen(mesh.vertices_xyz, mesh.normals, mesh.systematic, used, known)


def points_of_file(body: MeshBody, max_u: float) -> MeasuredPoints:
    """
    Return the vertices of a mesh file that are measured well enough, as far as the file says it.

    max_u : meters, greatest expanded uncertainty (k = 2) of a vertex
    """
    normals = vertex_normals(body.vertices_xyz, body.faces)
    if body.sigma is None:
        return MeasuredPoints(points_xyz=body.vertices_xyz, normals=normals)
    known = _known_well(body.sigma, body.systematic, max_u)
    used = np.isfinite(body.sigma) & np.isfinite(normals).all(axis=1)
    return _chosen(body.vertices_xyz, normals, body.systematic, used, known)


def _known_well(sigma: Floats, systematic: Floats | None, max_u: float) -> Bools:
    """Return (n,) bool; an unknown systematic error leaves a vertex in."""
    shared = 0.0 if systematic is None else np.nan_to_num(systematic)
    with np.errstate(invalid='ignore'):
        return np.asarray(COVERAGE_FACTOR * np.hypot(sigma, shared) <= max_u)


def _chosen(
    points: Floats, normals: Floats, systematic: Floats | None, used: Bools, known: Bools
) -> MeasuredPoints:
    chosen = used & known
    return MeasuredPoints(
        points_xyz=points[chosen],
        normals=normals[chosen],
        systematic=None if systematic is None else systematic[chosen],
        left_out=1.0 - float(chosen.sum()) / max(int(used.sum()), 1),
    )
