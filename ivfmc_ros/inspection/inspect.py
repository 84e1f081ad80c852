# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A mesh against its nominal: where it deviates, by how much, and whether that can be told."""

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import field

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.inspection import features
from ivfmc_ros.inspection import verdict as rule
from ivfmc_ros.inspection.alignment import align
from ivfmc_ros.inspection.alignment import Alignment
from ivfmc_ros.inspection.deviation import Deviation
from ivfmc_ros.inspection.deviation import summarise
from ivfmc_ros.inspection.nominal import Body
from ivfmc_ros.inspection.regions import Region
from ivfmc_ros.inspection.regions import regions_of
from ivfmc_ros.inspection.uncertainty import calibration_modes
from ivfmc_ros.inspection.uncertainty import Conditions
from ivfmc_ros.inspection.uncertainty import Modes
from ivfmc_ros.meshing import normals as triangle_normals
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.surface import Surface

# A vertex farther from the nominal than this share of its size belongs to no region.
_REACH = 0.02
# Vertices on a region that faces another way than they do belong to another one (60 degrees).
_SAME_SIDE = 0.5
# Points of a feature are taken so far away from the edges of its face, in metres: the stripe bends
# over an edge.
EDGE = 1.0e-3
_MOST_POINTS = 20_000


@dataclass(frozen=True, kw_only=True)
class InspectSettings:
    """
    How a mesh is judged. Lengths are metres.

    tolerance : largest deviation allowed to either side, of surface and sizes
    align : best_fit, global, none
    edge : vertices nearer to the edge of a face have no part in its fitted feature
    """

    tolerance: float = 0.1e-3
    align: str = 'best_fit'
    edge: float = EDGE
    conditions: Conditions = field(default_factory=Conditions)

    def __post_init__(self) -> None:
        rule.require_tolerance(self.tolerance)


@dataclass(frozen=True, eq=False, kw_only=True)
class Judged:
    """
    A region, or the whole: its deviations, share of vertices within tolerance, and the verdict.

    uncertainty : standard, metres, median over the vertices
    """

    name: str
    deviation: Deviation
    within: float
    uncertainty: float
    verdict: str


@dataclass(frozen=True, eq=False, kw_only=True)
class Sized:
    """
    A feature fitted to the measured points of a region, and judged by its diameter.

    uncertainty : standard, of the diameter, metres; NaN for a plane, which is judged by its form
    noise, calibration, conditions : what it is made of
    """

    name: str
    feature: features.Feature
    nominal: float
    uncertainty: float
    noise: float
    calibration: float
    conditions: float
    verdict: str


@dataclass(frozen=True, eq=False, kw_only=True)
class Inspection:
    """
    What was found out. Positions are in the frame of the nominal.

    vertices_xyz (n, 3), deviations (n,), uncertainty (n,) metres: of the mesh laid onto it
    calibrated : the uncertainty holds that of the calibration
    """

    vertices_xyz: Floats
    faces: Ints
    deviations: Floats
    uncertainty: Floats
    alignment: Alignment
    whole: Judged
    regions: list[Judged]
    sizes: list[Sized]
    calibrated: bool


def inspect(
    mesh: Body,
    nominal: Body,
    settings: InspectSettings,
    cell: Cell | None = None,
    alignment: Alignment | None = None,
) -> Inspection:
    """
    Compare a mesh with a closed nominal.

    cell : that measured it, for the uncertainty of its calibration; the mesh is in ``turntable``
    alignment : if it is known already, as from datum points
    :raises GeometryError: the mesh is empty or does not determine a pose
    """
    used = np.unique(mesh.faces)
    if not len(used):
        raise GeometryError('inspect: the mesh has no triangles')
    surface = Surface(nominal.vertices_xyz, nominal.faces)
    scaled = mesh.vertices_xyz * settings.conditions.to_reference
    alignment = alignment or align(scaled[used], surface, nominal.vertices_xyz, settings.align)
    T = alignment.nominal_from_mesh
    vertices = transforms.apply(T, scaled)
    normals = triangle_normals.of_vertices(mesh.vertices_xyz, mesh.faces)
    deviations = np.where(np.isfinite(normals[:, 0]), surface.signed_distance(vertices), np.nan)
    modes = _modes(cell, mesh.vertices_xyz, np.nan_to_num(normals))
    spread = modes.along(mesh.vertices_xyz, np.nan_to_num(normals), settings.align != 'none')
    noise = np.zeros(len(vertices)) if mesh.sigma is None else np.nan_to_num(mesh.sigma)
    # a length changes about the middle of what is compared
    lever = np.linalg.norm(vertices - vertices[used].mean(axis=0), axis=1)
    relative = settings.conditions.relative_u * lever
    uncertainty = np.sqrt(spread**2 + noise**2 + relative**2)
    found = regions_of(nominal.vertices_xyz, nominal.faces)
    owner = _owners(surface, found, nominal, vertices, normals @ T[:3, :3].T)
    context = _Context(
        mesh=mesh,
        vertices=vertices,
        deviations=deviations,
        uncertainty=uncertainty,
        modes=modes,
        noise=noise,
        settings=settings,
        nominal=nominal,
    )
    return Inspection(
        vertices_xyz=vertices,
        faces=mesh.faces,
        deviations=deviations,
        uncertainty=uncertainty,
        alignment=alignment,
        whole=_judged('all', np.isfinite(deviations), context),
        regions=_regions(found, owner, context),
        sizes=_sizes(found, owner, context),
        calibrated=bool(len(modes.shifts)),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class _Context:
    mesh: Body
    vertices: Floats
    deviations: Floats
    uncertainty: Floats
    modes: Modes
    noise: Floats
    settings: InspectSettings
    nominal: Body


def _modes(cell: Cell | None, points: Floats, normals: Floats) -> Modes:
    if cell is None:
        return Modes(shifts=np.zeros((0, len(points), 3)))
    return calibration_modes(cell, points, normals)


def _owners(
    surface: Surface, regions: Sequence[Region], nominal: Body, vertices: Floats, normals: Floats
) -> Ints:
    """Return of each vertex the region that it lies on, or -1."""
    near = surface.nearest(vertices)
    of_face = np.full(len(nominal.faces), -1)
    for number, region in enumerate(regions):
        of_face[region.faces] = number
    with np.errstate(invalid='ignore'):
        same = (near.normals * normals).sum(axis=1) > _SAME_SIDE
    close = near.distance < _REACH * nominal.diagonal
    return np.asarray(np.where(same & close, of_face[near.faces], -1))


def _regions(regions: Sequence[Region], owner: Ints, context: _Context) -> list[Judged]:
    judged = []
    for number, region in enumerate(regions):
        chosen = (owner == number) & np.isfinite(context.deviations)
        if chosen.any():
            judged.append(_judged(region.name, chosen, context))
    return judged


def _judged(name: str, chosen: Floats, context: _Context) -> Judged:
    deviations, u = context.deviations[chosen], context.uncertainty[chosen]
    tolerance = context.settings.tolerance
    return Judged(
        name=name,
        deviation=summarise(deviations),
        within=float(np.mean(np.abs(deviations) <= tolerance)),
        uncertainty=float(np.median(u)),
        verdict=rule.judge_surface(deviations, u, tolerance),
    )


def _sizes(regions: Sequence[Region], owner: Ints, context: _Context) -> list[Sized]:
    sizes = []
    for number, region in enumerate(regions):
        if region.shape is None:
            continue
        inner = _away_from_edges(region, context, np.flatnonzero(owner == number))
        try:
            sizes.append(_sized(region, region.shape, inner, context))
        except GeometryError:
            # too little of the face was seen to fit its shape
            continue
    return sizes


def _away_from_edges(region: Region, context: _Context, chosen: Ints) -> Ints:
    """Leave out vertices near the edges of a region, and thin the rest."""
    faces = context.nominal.faces
    others = np.delete(faces, region.faces, axis=0)
    if len(others) and len(chosen):
        beside = Surface(context.nominal.vertices_xyz, others)
        chosen = chosen[beside.nearest(context.vertices[chosen]).distance > context.settings.edge]
    return np.asarray(chosen[:: max(1, len(chosen) // _MOST_POINTS)])


def _sized(region: Region, shape: features.Feature, chosen: Ints, context: _Context) -> Sized:
    points = context.mesh.vertices_xyz[chosen] * context.settings.conditions.to_reference
    found = features.fit(shape.kind, points)
    modes = Modes(shifts=context.modes.shifts[:, chosen])
    sigma = float(np.sqrt(np.mean(context.noise[chosen] ** 2)))
    tolerance = context.settings.tolerance
    if shape.kind == 'plane':
        form_u = float(np.median(context.uncertainty[chosen]))
        return Sized(
            name=region.name,
            feature=found,
            nominal=float('nan'),
            uncertainty=float('nan'),
            noise=sigma,
            calibration=float('nan'),
            conditions=0.0,
            verdict=rule.judge(0.5 * found.form, form_u, tolerance),
        )
    calibration = modes.of(lambda moved: features.fit(shape.kind, moved).diameter, points)
    # of a full turn 2 sigma / sqrt(n); neighbours of a mesh share their noise
    noise = 2.0 * max(sigma, found.rms) / np.sqrt(max(1.0, len(points) / _SHARED))
    conditions = found.diameter * context.settings.conditions.relative_u
    u = float(np.linalg.norm([calibration, noise, conditions]))
    return Sized(
        name=region.name,
        feature=found,
        nominal=shape.diameter,
        uncertainty=u,
        noise=float(noise),
        calibration=calibration,
        conditions=conditions,
        verdict=rule.judge(found.diameter - shape.diameter, u, tolerance),
    )


# So many neighbouring vertices of a mesh count as one independent measurement.
_SHARED = 20.0
