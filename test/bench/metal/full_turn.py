# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A full turn of a part by two lasers, from path-traced pictures to a mesh, against its CAD."""

from collections.abc import Iterator
from dataclasses import dataclass
from dataclasses import replace

import numpy as np

from bench import at_most
from bench import Number
from bench.metal import parts
from bench.metal import pictures
from bench.metal.pictures import Half
from bench.metal.pictures import Shot
from ivfmc_ros.cell.volume import Volume
from ivfmc_ros.meshing.geometry.areas import points_by_area
from ivfmc_ros.meshing.geometry.areas import vertex_areas
from ivfmc_ros.meshing.geometry.normals import face_normals
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Frame
from ivfmc_ros.pipeline import reconstruct
from ivfmc_ros.pipeline import Reconstruction
from ivfmc_ros.pipeline import Settings
from ivfmc_ros.simulation.parts.loading import Solid
from ivfmc_ros.stripe.acquisition import AcquisitionSettings
from ivfmc_ros.surface import Surface

ANGLES = 200
# The platter is in the pictures too.
SETTINGS = Settings(acquisition=AcquisitionSettings(volume=Volume(bottom=0.5e-3)))
# The exposure is set by every so many pictures of the turn.
_METERED = 25
INVENTED = 0.5e-3  # meters from the CAD at which a surface is none of the part
COVERED = 0.5e-3  # meters of a point of the CAD from a mesh that covers it
_POINTS = 50_000  # on the CAD
_UNDERSIDE = 0.7  # cosine of a normal downward


@dataclass(frozen=True, eq=False, kw_only=True)
class Turn:
    """
    A mesh and how far it is off.

    distance, area : (n,) of the vertices: from the CAD, meters, and square meters around them
    sigma : (n,) meters, 1 sigma of noise and systematic error of the vertices, as claimed
    coverage : share of the area of the CAD, but for its underside, that the mesh covers
    """

    made: Reconstruction
    distance: Floats
    area: Floats
    sigma: Floats
    coverage: float

    def share(self, chosen: Bools) -> float:
        """Return the share of the area at the chosen vertices."""
        return float(self.area[chosen].sum() / self.area.sum())


def run(half: Half, material: str) -> Iterator[Number]:
    """Bars of a mesh of a full turn."""
    shots = pictures.turn(half, material, ANGLES)
    pictures.render_all(shots)
    found = turned(shots)
    rms = 1e3 * float(np.sqrt(np.average(found.distance**2, weights=found.area)))
    within = found.share(found.distance <= 0.1e-3)
    invented = 1e6 * float(found.area[found.distance > INVENTED].sum())
    name = f'{material}, full turn'
    note = f'{len(found.distance)} vertices, {100 * found.coverage:.0f} % of the CAD covered'
    yield Number(f'{name}: mesh to CAD, rms', rms, 'mm', at_most(0.05), note)
    note = f'largest distance {1e3 * found.distance.max():.3f} mm'
    yield Number(f'{name}: mesh off by more than 0.1 mm', 1.0 - within, '', at_most(0.05), note)
    note = f'of {1e6 * found.area.sum():.0f} mm2, farther than {1e3 * INVENTED:g} mm from the CAD'
    yield Number(f'{name}: invented surface', invented, 'mm2', at_most(0.0), note)
    claimed = found.share(found.distance < 2 * found.sigma)
    note = 'noise and systematic error of the vertices'
    yield Number(f'{name}: error below 2 sigma', claimed, '', None, note)


def turned(shots: list[Shot]) -> Turn:
    """Reconstruct the mesh of a turn of one part."""
    factor = pictures.exposure(shots[::_METERED])
    made = reconstruct(shots[0].scene.cell, frames(shots, factor), SETTINGS, len(shots))
    solid, mesh = getattr(parts, shots[0].part)(), made.mesh
    cad = Surface(solid.vertices_xyz, solid.faces)
    distance = np.abs(cad.signed_distance(mesh.vertices_xyz))
    systematic = 0.0 if mesh.systematic is None else np.nan_to_num(mesh.systematic)
    return Turn(
        made=made,
        distance=distance,
        area=vertex_areas(mesh.vertices_xyz, mesh.faces),
        sigma=np.hypot(mesh.sigma, systematic),
        coverage=covered(solid, Surface(mesh.vertices_xyz, mesh.faces)),
    )


def covered(solid: Solid, mesh: Surface) -> float:
    """Return the share of the area of a part, but for its underside, that a mesh covers."""
    upward = face_normals(solid.vertices_xyz, solid.faces)[:, 2]
    points, _ = points_by_area(solid.vertices_xyz, solid.faces[upward > -_UNDERSIDE], _POINTS)
    return float(np.mean(mesh.nearest(points).distance < COVERED))


def frames(shots: list[Shot], factor: float) -> Iterator[Frame]:
    for number, shot in enumerate(shots):
        yield replace(next(pictures.frames(shot, factor)), seq=number)
