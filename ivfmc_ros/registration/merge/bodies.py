# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A whole clamping as one rigid piece of surface, and from where it was seen."""

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
from ivfmc_ros.registration.merge.holes import Bore
from ivfmc_ros.registration.merge.holes import find_bores
from ivfmc_ros.registration.merge.line_segments import strokes_of
from ivfmc_ros.registration.merge.line_segments import strokes_together
from ivfmc_ros.registration.solver.downsample import common_edge
from ivfmc_ros.registration.solver.downsample import sample
from ivfmc_ros.registration.solver.surfels import fit_patches
from ivfmc_ros.registration.solver.surfels import joined
from ivfmc_ros.registration.solver.surfels import Patches
from ivfmc_ros.registration.views.assemble import sight_of

_LEAST_PATCHES = 200


@dataclass(frozen=True, eq=False, kw_only=True)
class Clamping:
    """
    One scan of a part: views at their places, in its own ``turntable``.

    name : for messages; cell : the one that the views were made with
    """

    name: str
    cell: Cell
    views: Sequence[View]
    poses: Poses


@dataclass(frozen=True, eq=False, kw_only=True)
class Body:
    """
    The surface of one clamping.

    patches : normals towards the camera; sight : (n, 3) unit, from the patches to the camera
    bores : round holes, whose walls are too narrow for patches
    """

    name: str
    patches: Patches
    sight: Floats
    bores: tuple[Bore, ...] = ()

    def __len__(self) -> int:
        return len(self.patches)

    def moved(self, T: Floats) -> 'Body':
        """Return the body moved by a rigid (4, 4) matrix."""
        return replace(
            self,
            patches=self.patches.posed(T),
            sight=self.sight @ T[:3, :3].T,
            bores=tuple(bore.moved(T) for bore in self.bores),
        )

    def thinned(self, edge: float) -> 'Body':
        """Return one patch for each cube of ``edge`` metres."""
        cube = np.floor(self.patches.points_xyz / edge).astype(np.int64)
        _, first = np.unique(cube, axis=0, return_index=True)
        return self.chosen(np.sort(first))

    def chosen(self, which: Ints) -> 'Body':
        """Return some of the patches."""
        return replace(self, patches=self.patches.chosen(which), sight=self.sight[which])


def bodies_of(clampings: Sequence[Clamping]) -> tuple[list[Body], float]:
    """
    Return the surface of each clamping, and how far patches are apart, metres.

    :raises GeometryError: a clamping has too little surface
    """
    edge = common_edge([view for clamping in clampings for view in clamping.views])
    bodies = []
    for clamping in clampings:
        body = _body(clamping, edge) if np.isfinite(edge) else None
        if body is None or len(body) < _LEAST_PATCHES:
            found = 0 if body is None else len(body)
            raise GeometryError(
                f'merge: {clamping.name}: only {found} pieces of surface; {_LEAST_PATCHES} are '
                'needed to find where it belongs'
            )
        bodies.append(body)
    return bodies, edge


def together(bodies: Sequence[Body]) -> Body:
    """Return several bodies as one."""
    return Body(
        name=' and '.join(body.name for body in bodies),
        patches=joined([body.patches for body in bodies]),
        sight=np.concatenate([body.sight for body in bodies]),
        bores=tuple(bore for body in bodies for bore in body.bores),
    )


def _body(clamping: Clamping, edge: float) -> Body | None:
    parts, strokes = [], []
    posed = zip(clamping.views, clamping.poses.turntable_from_view, strict=True)
    for view, T in posed:
        thin = sample(view, edge)
        sight = sight_of(clamping.cell, view)
        # which side was seen is known by the camera: the grid's sense changes beyond the axis
        thin = replace(thin, outward=thin.means(sight))
        patches = fit_patches(thin, edge)
        towards = thin.outward[patches.sample]
        towards = towards / np.linalg.norm(towards, axis=1, keepdims=True)
        parts.append(Body(name=clamping.name, patches=patches, sight=towards).moved(T))
        strokes.append(strokes_of(view, sight, edge).posed(T))
    if not parts:
        return None
    body = replace(together(parts), name=clamping.name)
    left = strokes_together(strokes).beside(body.patches, edge)
    return replace(body, bores=find_bores(left, body.patches, edge))
