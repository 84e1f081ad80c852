# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Inspection: deviations of a measured mesh from a nominal mesh, with uncertainty and verdicts."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.inspection import verdict as rule
from ivfmc_ros.inspection.alignment import Alignment
from ivfmc_ros.inspection.comparison import Comparison
from ivfmc_ros.inspection.deviation import Deviation
from ivfmc_ros.inspection.deviation import summarize
from ivfmc_ros.inspection.feature_measurement import FeatureResult
from ivfmc_ros.inspection.feature_measurement import measure_features
from ivfmc_ros.inspection.mesh_file import MeshBody
from ivfmc_ros.inspection.nominal_faults import align_to_nominal
from ivfmc_ros.inspection.nominal_faults import oriented
from ivfmc_ros.inspection.regions import segment_surface
from ivfmc_ros.inspection.regions import SurfaceRegion
from ivfmc_ros.inspection.settings import InspectSettings
from ivfmc_ros.inspection.uncertainty import calibration_modes
from ivfmc_ros.inspection.uncertainty import CalibrationModes
from ivfmc_ros.meshing.geometry import normals as triangle_normals
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.surface import Surface

# Largest distance of a vertex from its region, fraction of the nominal's diagonal.
_MAX_DISTANCE = 0.02
# Minimum cosine between the normals of a vertex and of the region it is assigned to (60 degrees).
_MIN_NORMAL_COSINE = 0.5


@dataclass(frozen=True, eq=False, kw_only=True)
class SurfaceResult:
    """
    Deviations and verdict of a region or of the whole surface.

    within : fraction of the vertices within tolerance
    uncertainty : meters, standard uncertainty of a deviation, median over the vertices
    """

    name: str
    deviation: Deviation
    within: float
    uncertainty: float
    verdict: str


@dataclass(frozen=True, eq=False, kw_only=True)
class Inspection:
    """
    Result of an inspection. Positions are in the frame of the nominal.

    vertices_xyz : (n, 3) meters, of the aligned mesh; faces : (m, 3)
    deviations : (n,) meters, positive outside; NaN at vertices that were not measured
    uncertainty : (n,) meters, standard uncertainty of the deviations
    calibrated : the uncertainty includes that of the calibration
    unseen : names of the nominal's regions without a measured vertex; they have no verdict
    notes : what was found wrong with the nominal, and what was done about it
    misplaced : the mesh does not lie on the nominal: nothing is decided
    """

    vertices_xyz: Floats
    faces: Ints
    deviations: Floats
    uncertainty: Floats
    alignment: Alignment
    whole: SurfaceResult
    regions: list[SurfaceResult]
    features: list[FeatureResult]
    calibrated: bool
    unseen: list[str]
    notes: list[str]
    misplaced: bool


def inspect(
    mesh: MeshBody,
    nominal: MeshBody,
    settings: InspectSettings,
    cell: Cell | None = None,
    alignment: Alignment | None = None,
) -> Inspection:
    """
    Compare a mesh with a closed nominal mesh.

    cell : cell that measured the mesh, for the uncertainty of its calibration; the mesh must then
        be in ``turntable``
    alignment : known alignment, for example from datum points; None: by ``settings.align``
    :raises GeometryError: the mesh is empty or does not determine a pose
    """
    nominal, notes = oriented(nominal)
    surface = Surface(nominal.vertices_xyz, nominal.faces)
    measured = _measured(mesh)
    scaled = mesh.vertices_xyz * settings.conditions.to_reference
    placing: list[str] = []
    if alignment is None:
        alignment, placing = align_to_nominal(scaled[measured], surface, nominal, settings.align)
    T = alignment.nominal_from_mesh
    vertices = transforms.apply(T, scaled)
    normals = triangle_normals.vertex_normals(mesh.vertices_xyz, mesh.faces)
    measured = measured[np.isfinite(normals[measured, 0])]
    deviations = _signed_distances(surface, vertices, measured)
    found = segment_surface(nominal.vertices_xyz, nominal.faces)
    owner = np.full(len(vertices), -1)
    turned = normals[measured] @ T[:3, :3].T
    owner[measured] = _assign_regions(surface, found, nominal, vertices[measured], turned)
    modes = _modes(cell, mesh.vertices_xyz, np.nan_to_num(normals))
    noise = np.zeros(len(vertices)) if mesh.sigma is None else np.nan_to_num(mesh.sigma)
    free = settings.align != 'none'
    calibration_u = modes.along_normals(mesh.vertices_xyz, np.nan_to_num(normals), free)
    relative = settings.conditions.relative_u * _lever_arm(vertices, measured)
    comparison = Comparison(
        mesh=mesh,
        vertices_xyz=vertices,
        deviations=deviations,
        uncertainty=np.sqrt(calibration_u**2 + noise**2 + relative**2),
        modes=modes,
        noise=noise,
        settings=settings,
        nominal=nominal,
    )
    return Inspection(
        vertices_xyz=vertices,
        faces=mesh.faces,
        deviations=deviations,
        uncertainty=comparison.uncertainty,
        alignment=alignment,
        whole=_surface_result('all', np.isfinite(deviations), comparison),
        regions=_regions(found, owner, comparison),
        features=measure_features(found, owner, comparison),
        calibrated=bool(len(modes.shifts)),
        notes=notes + placing,
        misplaced=bool(placing) and alignment.method == settings.align,
        unseen=[region.name for k, region in enumerate(found) if not (owner == k).any()],
    )


def _signed_distances(surface: Surface, vertices: Floats, measured: Ints) -> Floats:
    """Return (n,) meters from the surface; NaN for what was not measured."""
    deviations = np.full(len(vertices), np.nan)
    deviations[measured] = surface.signed_distance(vertices[measured])
    return deviations


def _lever_arm(vertices: Floats, measured: Ints) -> Floats:
    """Return the distance from the centroid, on which scale and temperature act, meters."""
    return np.asarray(np.linalg.norm(vertices - vertices[measured].mean(axis=0), axis=1))


def _measured(mesh: MeshBody) -> Ints:
    """Return the indices of measured vertices, without those of hole filling (no sigma)."""
    measured = np.unique(mesh.faces)
    if not len(measured):
        raise GeometryError('inspect: the mesh has no triangles')
    if mesh.sigma is None or not np.isfinite(mesh.sigma[measured]).any():
        # without sigma, measured and filled vertices cannot be told apart
        return measured
    return measured[np.isfinite(mesh.sigma[measured])]


def _modes(cell: Cell | None, points: Floats, normals: Floats) -> CalibrationModes:
    if cell is None:
        return CalibrationModes(shifts=np.zeros((0, len(points), 3)))
    return calibration_modes(cell, points, normals)


def _assign_regions(
    surface: Surface,
    regions: Sequence[SurfaceRegion],
    nominal: MeshBody,
    vertices: Floats,
    normals: Floats,
) -> Ints:
    """Return the index of the region of each vertex, or -1, (n,)."""
    near = surface.nearest(vertices)
    of_face = np.full(len(nominal.faces), -1)
    for number, region in enumerate(regions):
        of_face[region.faces] = number
    with np.errstate(invalid='ignore'):
        same_side = (near.normals * normals).sum(axis=1) > _MIN_NORMAL_COSINE
    close = near.distance < _MAX_DISTANCE * nominal.diagonal
    return np.asarray(np.where(same_side & close, of_face[near.faces], -1))


def _regions(
    regions: Sequence[SurfaceRegion], owner: Ints, comparison: Comparison
) -> list[SurfaceResult]:
    results = []
    for number, region in enumerate(regions):
        chosen = (owner == number) & np.isfinite(comparison.deviations)
        if chosen.any():
            results.append(_surface_result(region.name, chosen, comparison))
    return results


def _surface_result(name: str, chosen: Floats, comparison: Comparison) -> SurfaceResult:
    deviations, u = comparison.deviations[chosen], comparison.uncertainty[chosen]
    tolerance = comparison.settings.tolerance
    return SurfaceResult(
        name=name,
        deviation=summarize(deviations),
        within=float(np.mean(np.abs(deviations) <= tolerance)),
        uncertainty=float(np.median(u)),
        verdict=rule.judge_surface(deviations, u, tolerance),
    )
