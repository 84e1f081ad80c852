# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The surface of a clamping as surfels, viewing directions and holes.

All views of a scan are transformed by their poses and joined to one rigid surface.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace

import numpy as np

from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Poses
from ivfmc_ros.model import View
from ivfmc_ros.registration.merge.holes import find_holes
from ivfmc_ros.registration.merge.holes import Hole
from ivfmc_ros.registration.merge.line_segments import concatenate_segments
from ivfmc_ros.registration.merge.line_segments import extract_line_segments
from ivfmc_ros.registration.solver.downsample import common_voxel_size
from ivfmc_ros.registration.solver.downsample import downsample
from ivfmc_ros.registration.solver.surfels import concatenate_surfels
from ivfmc_ros.registration.solver.surfels import fit_surfels
from ivfmc_ros.registration.solver.surfels import Surfels
from ivfmc_ros.registration.views.assemble import viewing_vectors

# Fewer surfels do not determine a pose by point pair features and their overlap.
_MIN_SURFELS = 200


@dataclass(frozen=True, eq=False, kw_only=True)
class Clamping:
    """
    One scan of a part, which is clamped on the table in one way.

    name : of the scan, for messages
    cell : that the views were made with
    views, poses : registered, in the frame ``turntable`` of this scan
    """

    name: str
    cell: Cell
    views: Sequence[View]
    poses: Poses


@dataclass(frozen=True, eq=False, kw_only=True)
class ClampedSurface:
    """
    The surface that the views of one or several clampings show.

    surfels : n, with normals towards the camera
    sight : (n, 3) unit vectors from the surfels to the camera
    holes : round holes; their walls are too narrow for surfels
    """

    name: str
    surfels: Surfels
    sight: Floats
    holes: tuple[Hole, ...] = ()

    def __len__(self) -> int:
        return len(self.surfels)

    def transformed(self, T: Floats) -> 'ClampedSurface':
        """Return the surface transformed by a rigid (4, 4) matrix."""
        return replace(
            self,
            surfels=self.surfels.transformed(T),
            sight=self.sight @ T[:3, :3].T,
            holes=tuple(hole.transformed(T) for hole in self.holes),
        )

    def downsampled(self, voxel: float) -> 'ClampedSurface':
        """Return one surfel per cube of ``voxel`` meters."""
        cube = np.floor(self.surfels.points_xyz / voxel).astype(np.int64)
        _, first = np.unique(cube, axis=0, return_index=True)
        return self.selected(np.sort(first))

    def selected(self, index: Ints) -> 'ClampedSurface':
        """Return the surfels of the given indices, and all holes."""
        return replace(self, surfels=self.surfels.select(index), sight=self.sight[index])


def clamping_surfaces(clampings: Sequence[Clamping]) -> tuple[list[ClampedSurface], float]:
    """
    Return the surface of each clamping, and the spacing of the surfels in meters.

    :raises GeometryError: a clamping has too little surface
    """
    spacing = common_voxel_size([view for clamping in clampings for view in clamping.views])
    surfaces = []
    for clamping in clampings:
        surface = _surface(clamping, spacing) if np.isfinite(spacing) else None
        if surface is None or len(surface) < _MIN_SURFELS:
            found = 0 if surface is None else len(surface)
            raise GeometryError(
                f'merge: {clamping.name}: only {found} surfels; {_MIN_SURFELS} are needed to find '
                'its pose'
            )
        surfaces.append(surface)
    return surfaces, spacing


def union(surfaces: Sequence[ClampedSurface]) -> ClampedSurface:
    """Return several surfaces as one."""
    return ClampedSurface(
        name=' and '.join(surface.name for surface in surfaces),
        surfels=concatenate_surfels([surface.surfels for surface in surfaces]),
        sight=np.concatenate([surface.sight for surface in surfaces]),
        holes=tuple(hole for surface in surfaces for hole in surface.holes),
    )


def _surface(clamping: Clamping, spacing: float) -> ClampedSurface | None:
    parts, segments = [], []
    posed = zip(clamping.views, clamping.poses.turntable_from_view, strict=True)
    for view, T in posed:
        samples = downsample(view, spacing)
        sight = viewing_vectors(clamping.cell, view)
        # the sense of grid normals changes beyond the axis; the camera always sees the outside
        samples = replace(samples, outward=samples.means(sight))
        surfels = fit_surfels(samples, spacing)
        towards = samples.outward[surfels.sample]
        towards = towards / np.linalg.norm(towards, axis=1, keepdims=True)
        part = ClampedSurface(name=clamping.name, surfels=surfels, sight=towards)
        parts.append(part.transformed(T))
        segments.append(extract_line_segments(view, sight, spacing).transformed(T))
    if not parts:
        return None
    surface = replace(union(parts), name=clamping.name)
    beside = concatenate_segments(segments).without_surfels(surface.surfels, spacing)
    return replace(surface, holes=find_holes(beside, surface.surfels, spacing))
