# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Builds one triangle mesh from registered views, by the method that the settings name."""

from collections.abc import Sequence
import math

import numpy as np

from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.meshing.filters.decimate import decimate
from ivfmc_ros.meshing.integrate import integrate
from ivfmc_ros.meshing.paper.zipper import zipper_views
from ivfmc_ros.meshing.poisson import poisson
from ivfmc_ros.meshing.samples.range_grid import median_spacings
from ivfmc_ros.meshing.samples.view_samples import sample_views
from ivfmc_ros.meshing.settings import MeshSettings
from ivfmc_ros.model import Mesh
from ivfmc_ros.model import Poses
from ivfmc_ros.model import View
from ivfmc_ros.registration.views.assemble import spacing
from ivfmc_ros.registration.views.assemble import within_one_turn

# Neighbors on one surface are at most so many point spacings apart.
_MAX_EDGE_SPACINGS = 5.0
# Voxel of integrate in point spacings. Small, so that edges stay sharp; noise is averaged by the
# filter of normals, not by the voxel.
_VOXEL_SPACINGS = 0.6
# A decimated mesh with fewer faces per point is as fine as the data.
_FACES_PER_POINT = 2
# Greatest default voxel, in units of the smaller of both spacings.
_MAX_SMALLER_SPACINGS = 2.0


def build_mesh(
    cell: Cell, views: Sequence[View], poses: Poses, settings: MeshSettings | None = None
) -> Mesh:
    """
    Build the surface of all views.

    What a sweep measured beyond a turn is a check of the table, and no part of the surface.

    poses : the pose of each view in ``turntable``
    settings : None for the defaults
    returns : Mesh in ``turntable``, meters
    :raises GeometryError: the views contain no surface
    :raises ParameterError: the voxel is too small for the part
    """
    settings = settings or MeshSettings()
    views = [within_one_turn(view) for view in views]
    max_edge = settings.max_edge or default_max_edge(views)
    if settings.method == 'paper':
        mesh = zipper_views(cell, views, poses, max_edge)
    else:
        share = _VOXEL_SPACINGS if settings.method == 'integrate' else 1.0
        voxel = settings.voxel or share * default_voxel(views)
        samples = sample_views(cell, views, poses, max_edge, voxel)
        if settings.method == 'poisson':
            mesh = poisson(samples, voxel, max_edge, settings)
        else:
            mesh = integrate(samples, voxel, settings)
    return _decimated(mesh, views, settings)


def _decimated(mesh: Mesh, views: Sequence[View], settings: MeshSettings) -> Mesh:
    """Return the mesh with as few faces as ``decimate`` allows, or not many more than points."""
    if settings.decimate or settings.method != 'integrate':
        return decimate(mesh, settings.decimate)[0]
    known = np.concatenate([view.sigma[np.isfinite(view.sigma)] for view in views])
    tolerance = settings.decimate_sigmas * float(np.median(known)) if len(known) else 0.0
    points = sum(int(np.count_nonzero(view.valid)) for view in views)
    return decimate(mesh, tolerance, _FACES_PER_POINT * points)[0]


def default_max_edge(views: Sequence[View]) -> float:
    """
    Return 5 point spacings of the coarsest view, meters.

    :raises GeometryError: no view has two neighboring points at different places
    """
    known = [step for step in map(spacing, views) if math.isfinite(step)]
    if not known:
        raise GeometryError(
            'meshing: no view has two neighboring points at different places; scan in finer steps'
        )
    return _MAX_EDGE_SPACINGS * max(known)


def default_voxel(views: Sequence[View]) -> float:
    """
    Return the median point spacing of the views, meters: the edge of a square per point.

    It is the geometric mean of the spacings along and across profiles, but at most twice the
    smaller one, so that widely spaced profiles do not lose their resolution.

    :raises GeometryError: no view has neighboring points both along and across profiles
    """
    steps = np.array([median_spacings(view.points_xyz) for view in views]).reshape(-1, 2)
    steps = steps[np.isfinite(steps).all(axis=1)]
    if not len(steps):
        raise GeometryError(
            'meshing: no three neighboring points in neighboring profiles; scan in finer steps'
        )
    down, across = np.median(steps, axis=0)
    return float(min(np.sqrt(down * across), _MAX_SMALLER_SPACINGS * min(down, across)))
