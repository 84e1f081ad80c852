# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Meshing of degenerate views: coincident points and single profiles."""

import numpy as np
import pytest
from support.degraded_views import CELL
from support.degraded_views import mesh_defects
from support.degraded_views import views

from ivfmc_ros.errors import GeometryError
from ivfmc_ros.meshing.build import build_mesh
from ivfmc_ros.meshing.settings import MeshSettings
from ivfmc_ros.model import Poses
from ivfmc_ros.model import View

METHODS = ('integrate', 'paper', 'poisson')
STEP = 4e-4  # meters


def built(view, method):
    settings = MeshSettings(method=method, floor=None)
    return build_mesh(CELL, [view], Poses.identity(1), settings)


def upright(rows, columns):
    """Return a view of an upright plane; columns and rows are positions of its points in steps."""
    places = np.broadcast_arrays(0.01, STEP * columns[None], 0.03 + STEP * rows[:, None])
    shape = (len(rows), len(columns))
    return View(
        number=0,
        laser=0,
        points_xyz=np.stack(places, axis=2),
        intensity=np.full(shape, 100.0),
        sigma=np.full(shape, 1e-5),
        uv=np.zeros((*shape, 2)),
        angles=np.linspace(0.0, 1.0, shape[1]),
        seqs=np.arange(shape[1]),
    )


@pytest.mark.parametrize('method', METHODS)
def test_million_points_at_one_place_are_refused(method):
    one = np.zeros(1000)
    with pytest.raises(GeometryError, match='no view has two neighboring points at different'):
        built(upright(one, one), method)


@pytest.mark.slow
@pytest.mark.parametrize('method', METHODS)
def test_million_points_at_a_hundred_places_are_no_failure(method):
    place = np.arange(1000.0) // 100
    try:
        mesh = built(upright(place, place), method)
    except GeometryError as error:
        assert str(error).startswith('meshing: ')
        assert '0.00 mm' not in str(error)
        assert method != 'integrate'
    else:
        assert len(mesh.faces) >= 81
        assert np.ptp(mesh.vertices_xyz[:, 0]) < STEP


@pytest.mark.parametrize('method', METHODS)
def test_view_of_one_profile_is_refused(method):
    (view,) = views(1, steps=1)
    with pytest.raises(GeometryError, match=r'^meshing: no three neighboring points'):
        built(view, method)


def test_single_view_makes_a_sound_mesh():
    settings = MeshSettings(floor=None, voxel=1e-3)
    mesh = build_mesh(CELL, views(1), Poses.identity(1), settings)
    assert mesh_defects(mesh, closed=False) == []
