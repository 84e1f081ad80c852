# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The one way from views to a mesh, whichever method is asked for."""

from collections.abc import Sequence
import math

import numpy as np

from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.meshing.filters.decimate import decimated
from ivfmc_ros.meshing.integrate import integrate
from ivfmc_ros.meshing.paper.zipper import join_views
from ivfmc_ros.meshing.poisson import poisson
from ivfmc_ros.meshing.samples import surface_samples as sampling
from ivfmc_ros.meshing.samples.view_samples import from_views
from ivfmc_ros.meshing.settings import MeshSettings
from ivfmc_ros.model import Mesh
from ivfmc_ros.model import Poses
from ivfmc_ros.model import View
from ivfmc_ros.registration.views.assemble import spacing

# Points of one surface are at most this many point spacings apart.
_REACH = 5.0
# Of the spacing of the points: so fine that edges stay sharp; the filter of normals averages.
_VOXEL = 0.6
_FINEST = 2.0  # of the smaller spacing


def build_mesh(
    cell: Cell, views: Sequence[View], poses: Poses, settings: MeshSettings | None = None
) -> Mesh:
    """
    Return the surface of all views in ``turntable``.

    :raises GeometryError: the views hold no surface
    :raises ParameterError: the voxel is too small for the part
    """
    settings = settings or MeshSettings()
    reach = settings.max_edge or usual_edge(views)
    if settings.method == 'paper':
        mesh = join_views(cell, views, poses, reach)
    else:
        share = _VOXEL if settings.method == 'integrate' else 1.0
        voxel = settings.voxel or share * usual_voxel(views)
        samples = from_views(cell, views, poses, reach, voxel)
        if settings.method == 'poisson':
            mesh = poisson(samples, voxel, reach, settings)
        else:
            mesh = integrate(samples, voxel, settings)
    return decimated(mesh, settings.decimate)[0] if settings.decimate else mesh


def usual_edge(views: Sequence[View]) -> float:
    """
    Return 5 point spacings, metres.

    :raises GeometryError: no two points of a view are neighbours at different places
    """
    known = [step for step in map(spacing, views) if math.isfinite(step)]
    if not known:
        raise GeometryError(
            'meshing: no view has two neighbouring points at different places; scan finer'
        )
    return _REACH * max(known)


def usual_voxel(views: Sequence[View]) -> float:
    """
    Return the spacing of the points of a view, metres: the edge of a square for each.

    Where profiles are much farther apart than the points of one, it is not worth to blur these.

    :raises GeometryError: no view has points that are neighbours both ways
    """
    steps = np.array([sampling.spacings(view.points_xyz) for view in views]).reshape(-1, 2)
    steps = steps[np.isfinite(steps).all(axis=1)]
    if not len(steps):
        raise GeometryError(
            'meshing: no three neighbouring points in neighbouring profiles; scan in finer steps'
        )
    down, across = np.median(steps, axis=0)
    return float(min(np.sqrt(down * across), _FINEST * min(down, across)))
