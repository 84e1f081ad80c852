# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Inspection: deviations of a measured mesh from a nominal mesh, with uncertainty and verdicts."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.scale import doubt_text
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.inspection.alignment import Alignment
from ivfmc_ros.inspection.comparison import Comparison
from ivfmc_ros.inspection.comparison import VertexUncertainty
from ivfmc_ros.inspection.edges import edge_distance
from ivfmc_ros.inspection.edges import region_of_faces
from ivfmc_ros.inspection.feature_measurement import FeatureResult
from ivfmc_ros.inspection.feature_measurement import measure_features
from ivfmc_ros.inspection.mesh_file import MeshBody
from ivfmc_ros.inspection.missing_surface import missing_surface
from ivfmc_ros.inspection.missing_surface import MissingSurface
from ivfmc_ros.inspection.nominal_faults import align_to_nominal
from ivfmc_ros.inspection.nominal_faults import oriented
from ivfmc_ros.inspection.regions import segment_surface
from ivfmc_ros.inspection.regions import SurfaceRegion
from ivfmc_ros.inspection.sampled_mesh import sampled
from ivfmc_ros.inspection.section_cut import section_cuts
from ivfmc_ros.inspection.section_cut import SectionCut
from ivfmc_ros.inspection.settings import InspectSettings
from ivfmc_ros.inspection.surface_measurement import measure_surface
from ivfmc_ros.inspection.surface_measurement import SurfaceResult
from ivfmc_ros.inspection.uncertainty import CalibrationModel
from ivfmc_ros.meshing.geometry import normals as triangle_normals
from ivfmc_ros.meshing.geometry.areas import vertex_areas
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.surface import Nearest
from ivfmc_ros.surface import Surface

# Largest distance of a vertex from its region, fraction of the nominal's diagonal.
_MAX_DISTANCE = 0.02
# Minimum cosine between the normals of a vertex and of the region it is assigned to (60 degrees).
_MIN_NORMAL_COSINE = 0.5
# Vertices with a larger systematic error do not determine the pose, meters; with fewer vertices
# than this share below it, all do.
_MAX_ALIGNING_SYSTEMATIC, _MIN_ALIGNING = 20e-6, 0.2


@dataclass(frozen=True, eq=False, kw_only=True)
class Inspection:
    """
    Result of an inspection. Positions are in the frame of the nominal.

    vertices_xyz : (n, 3) meters, of the aligned mesh with its long edges halved; faces : (m, 3)
    deviations : (n,) meters, positive outside; NaN at vertices that were not measured
    uncertainty : (n,) meters, standard uncertainty of the deviations; NaN if it is not known
    region_names : of all regions of the nominal, the largest first; their numbers begin at 1
    owner : (n,) index in ``region_names`` of the region of each vertex, -1 for none
    calibrated : the uncertainty includes that of the calibration, or was stated as a whole
    sections : cuts of mesh and nominal by ``settings.sections``
    unseen : names of the nominal's regions without a measured vertex; they have no verdict
    missing : what of the nominal was not measured, and how to lay the part for a further scan;
        None where the cell is not known or the mesh does not lie on the nominal
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
    region_names: list[str]
    sections: list[SectionCut]
    owner: Ints
    calibrated: bool
    unseen: list[str]
    missing: MissingSurface | None
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
    :raises ParameterError: a tolerance is for a feature that the nominal does not have, or a
        section does not cut it
    """
    mesh = sampled(mesh)
    nominal, notes = oriented(nominal)
    found = segment_surface(nominal.vertices_xyz, nominal.faces)
    settings.tolerances.require_known(['all', *(region.name for region in found)])
    surface = Surface(nominal.vertices_xyz, nominal.faces)
    measured = _measured(mesh)
    placing: list[str] = []
    if alignment is None:
        scaled = mesh.vertices_xyz * settings.conditions.to_reference
        sound = _without_great_bias(mesh, measured)
        alignment, placing = align_to_nominal(scaled[sound], surface, nominal, settings)
    comparison = _compare(mesh, nominal, settings, cell, alignment, surface, found, measured)
    owner = comparison.owner
    regions = [
        measure_surface(region.name, owner == number, region.area, comparison)
        for number, region in enumerate(found)
        if (comparison.measured & (owner == number)).any()
    ]
    area = float(sum(region.area for region in found))
    of_face = region_of_faces(found, len(nominal.faces))
    misplaced = bool(placing) and alignment.method == settings.align
    return Inspection(
        vertices_xyz=comparison.vertices_xyz,
        faces=mesh.faces,
        deviations=comparison.deviations,
        uncertainty=comparison.uncertainty.combined,
        alignment=alignment,
        whole=measure_surface('all', comparison.measured, area, comparison),
        regions=regions,
        features=measure_features(found, comparison),
        region_names=[region.name for region in found],
        sections=section_cuts(settings.sections, comparison, nominal, surface, of_face),
        owner=owner,
        calibrated=settings.vertex_u is not None or len(comparison.model.rigid) > 0,
        notes=notes + placing + _notes(mesh, settings, cell, comparison),
        misplaced=misplaced,
        unseen=[region.name for k, region in enumerate(found) if not (owner == k).any()],
        missing=None if cell is None or misplaced else _missing(nominal, found, comparison, cell),
    )


def _missing(
    nominal: MeshBody, regions: Sequence[SurfaceRegion], comparison: Comparison, cell: Cell
) -> MissingSurface:
    measured = comparison.measured
    R = comparison.nominal_from_mesh[:3, :3]
    return missing_surface(
        nominal,
        regions,
        comparison.vertices_xyz[measured],
        comparison.normals[measured] @ R.T,
        cell,
    )


def _compare(
    mesh: MeshBody,
    nominal: MeshBody,
    settings: InspectSettings,
    cell: Cell | None,
    alignment: Alignment,
    surface: Surface,
    regions: Sequence[SurfaceRegion],
    measured: Ints,
) -> Comparison:
    T = alignment.nominal_from_mesh
    vertices = transforms.apply(T, mesh.vertices_xyz * settings.conditions.to_reference)
    normals = triangle_normals.vertex_normals(mesh.vertices_xyz, mesh.faces)
    measured = measured[np.isfinite(normals[measured, 0])]
    normals = np.nan_to_num(normals)
    of_face = region_of_faces(regions, len(nominal.faces))
    owner, inner = np.full(len(vertices), -1), np.zeros(len(vertices), dtype=bool)
    near = surface.nearest(vertices[measured])
    owner[measured] = _assign_regions(of_face, near, normals[measured] @ T[:3, :3].T, nominal)
    inner[measured] = (
        edge_distance(nominal.vertices_xyz, nominal.faces, of_face, vertices[measured])
        > settings.edge
    )
    deviations = np.full(len(vertices), np.nan)
    deviations[measured] = surface.signed_distance(vertices[measured])
    aligned = alignment.method != 'none'
    model = CalibrationModel.of(cell, mesh.vertices_xyz, normals, aligned=aligned)
    return Comparison(
        mesh=mesh,
        normals=normals,
        nominal_from_mesh=T,
        vertices_xyz=vertices,
        area=vertex_areas(mesh.vertices_xyz, mesh.faces),
        deviations=deviations,
        uncertainty=_uncertainty(mesh, settings, model, _lever_arm(vertices, measured)),
        owner=owner,
        inner=inner,
        model=model,
        settings=settings,
    )


def _uncertainty(
    mesh: MeshBody, settings: InspectSettings, model: CalibrationModel, lever: Floats
) -> VertexUncertainty:
    count = len(mesh.vertices_xyz)
    nothing, unknown = np.zeros(count), np.full(count, np.nan)
    if settings.vertex_u is not None:
        return VertexUncertainty(
            noise=nothing,
            systematic=np.full(count, settings.vertex_u),
            calibration=nothing,
            conditions=settings.conditions.relative_u * lever,
        )
    return VertexUncertainty(
        noise=unknown if mesh.sigma is None else mesh.sigma,
        systematic=unknown if mesh.systematic is None else mesh.systematic,
        calibration=model.along_normals,
        conditions=settings.conditions.relative_u * lever,
    )


def _notes(
    mesh: MeshBody, settings: InspectSettings, cell: Cell | None, comparison: Comparison
) -> list[str]:
    """Return what is not known of the uncertainty."""
    if settings.vertex_u is not None:
        return []
    doubt = '' if cell is None else doubt_text(cell.notes)
    found = [f'scale: {doubt}; calibrate the cell again'] if doubt else []
    if mesh.sigma is None or not np.isfinite(mesh.sigma).any():
        found.append(
            'mesh: the file states no uncertainty of its vertices (sigma): no verdict; use the '
            'PLY file, keep the .npz file beside the STL file, or state it as vertex_u'
        )
    elif mesh.systematic is None or not np.isfinite(mesh.systematic).any():
        found.append(
            'mesh: the file states no systematic error of the stripe: no verdict; the cell must '
            'state the thickness of the light sheets, and the mesh be made by method integrate'
        )
    if not len(comparison.model.rigid):
        found.append(
            'cell: no covariance of the calibration is known: no verdict; name a cell with '
            'covariances, as ivfmc calibrate writes them'
        )
    elif not settings.conditions.scale_u:
        found.append(
            'scale: no uncertainty of the length that gave the scale is stated (scale_u); lengths '
            'are judged as if it were exact'
        )
    return found


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


def _without_great_bias(mesh: MeshBody, measured: Ints) -> Ints:
    """Return the measured vertices that determine the pose."""
    if mesh.systematic is None:
        return measured
    with np.errstate(invalid='ignore'):
        sound = measured[mesh.systematic[measured] <= _MAX_ALIGNING_SYSTEMATIC]
    return sound if len(sound) > _MIN_ALIGNING * len(measured) else measured


def _assign_regions(of_face: Ints, near: Nearest, normals: Floats, nominal: MeshBody) -> Ints:
    """Return the index of the region of each vertex, or -1, (n,)."""
    same_side = (near.normals * normals).sum(axis=1) > _MIN_NORMAL_COSINE
    close = near.distance < _MAX_DISTANCE * nominal.diagonal
    return np.asarray(np.where(same_side & close, of_face[near.faces], -1))
