# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A mesh against its nominal: where it deviates, by how much, and whether that can be told."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.inspection import verdict as rule
from ivfmc_ros.inspection.alignment import align
from ivfmc_ros.inspection.alignment import Alignment
from ivfmc_ros.inspection.compared import Compared
from ivfmc_ros.inspection.deviation import Deviation
from ivfmc_ros.inspection.deviation import summarise
from ivfmc_ros.inspection.nominal import Body
from ivfmc_ros.inspection.regions import Region
from ivfmc_ros.inspection.regions import regions_of
from ivfmc_ros.inspection.settings import InspectSettings
from ivfmc_ros.inspection.sizes import Sized
from ivfmc_ros.inspection.sizes import sizes
from ivfmc_ros.inspection.uncertainty import calibration_modes
from ivfmc_ros.inspection.uncertainty import Modes
from ivfmc_ros.meshing.geometry import normals as triangle_normals
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.surface import Surface

# A vertex farther from the nominal than this share of its size belongs to no region.
_REACH = 0.02
# Vertices on a region that faces another way than they do belong to another one (60 degrees).
_SAME_SIDE = 0.5


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
class Inspection:
    """
    What was found out. Positions are in the frame of the nominal.

    vertices_xyz (n, 3), deviations (n,), uncertainty (n,) metres: of the mesh laid onto it
        deviations are NaN where the surface was not seen but closed
    calibrated : the uncertainty holds that of the calibration
    unseen : names of the nominal's faces of which nothing was measured; they are not judged
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
    unseen: list[str]


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
    surface = Surface(nominal.vertices_xyz, nominal.faces)
    used = _measured(mesh)
    scaled = mesh.vertices_xyz * settings.conditions.to_reference
    alignment = alignment or align(scaled[used], surface, nominal.vertices_xyz, settings.align)
    T = alignment.nominal_from_mesh
    vertices = transforms.apply(T, scaled)
    normals = triangle_normals.of_vertices(mesh.vertices_xyz, mesh.faces)
    used = used[np.isfinite(normals[used, 0])]
    deviations = np.full(len(vertices), np.nan)
    deviations[used] = surface.signed_distance(vertices[used])
    found = regions_of(nominal.vertices_xyz, nominal.faces)
    owner = np.full(len(vertices), -1)
    turned = normals[used] @ T[:3, :3].T
    owner[used] = _owners(surface, found, nominal, vertices[used], turned)
    modes = _modes(cell, mesh.vertices_xyz, np.nan_to_num(normals))
    noise = np.zeros(len(vertices)) if mesh.sigma is None else np.nan_to_num(mesh.sigma)
    spread = modes.along(mesh.vertices_xyz, np.nan_to_num(normals), settings.align != 'none')
    # a length changes about the middle of what is compared
    lever = np.linalg.norm(vertices - vertices[used].mean(axis=0), axis=1)
    relative = settings.conditions.relative_u * lever
    compared = Compared(
        mesh=mesh,
        vertices_xyz=vertices,
        deviations=deviations,
        uncertainty=np.sqrt(spread**2 + noise**2 + relative**2),
        modes=modes,
        noise=noise,
        settings=settings,
        nominal=nominal,
    )
    return Inspection(
        vertices_xyz=vertices,
        faces=mesh.faces,
        deviations=deviations,
        uncertainty=compared.uncertainty,
        alignment=alignment,
        whole=_judged('all', np.isfinite(deviations), compared),
        regions=_regions(found, owner, compared),
        sizes=sizes(found, owner, compared),
        calibrated=bool(len(modes.shifts)),
        unseen=[region.name for k, region in enumerate(found) if not (owner == k).any()],
    )


def _measured(mesh: Body) -> Ints:
    """Return the vertices that say something of the part: not those that close the mesh."""
    used = np.unique(mesh.faces)
    if not len(used):
        raise GeometryError('inspect: the mesh has no triangles')
    if mesh.sigma is None or not np.isfinite(mesh.sigma[used]).any():
        # a file without sigma does not tell them apart
        return used
    return used[np.isfinite(mesh.sigma[used])]


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


def _regions(regions: Sequence[Region], owner: Ints, compared: Compared) -> list[Judged]:
    judged = []
    for number, region in enumerate(regions):
        chosen = (owner == number) & np.isfinite(compared.deviations)
        if chosen.any():
            judged.append(_judged(region.name, chosen, compared))
    return judged


def _judged(name: str, chosen: Floats, compared: Compared) -> Judged:
    deviations, u = compared.deviations[chosen], compared.uncertainty[chosen]
    tolerance = compared.settings.tolerance
    return Judged(
        name=name,
        deviation=summarise(deviations),
        within=float(np.mean(np.abs(deviations) <= tolerance)),
        uncertainty=float(np.median(u)),
        verdict=rule.judge_surface(deviations, u, tolerance),
    )
