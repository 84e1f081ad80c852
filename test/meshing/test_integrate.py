# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from support.degraded_views import CELL
from support.degraded_views import degrade
from support.degraded_views import mesh_defects
from support.degraded_views import SPHERE
from support.degraded_views import views

from ivfmc_ros.errors import GeometryError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.meshing.build import build_mesh
from ivfmc_ros.meshing.geometry.topology import boundary_loops
from ivfmc_ros.meshing.settings import MeshSettings
from ivfmc_ros.model import FILLED
from ivfmc_ros.model import MEASURED
from ivfmc_ros.model import Poses
from ivfmc_ros.registration.views.assemble import without


def edge_counts(mesh):
    edges = np.sort(np.stack([mesh.faces, np.roll(mesh.faces, 1, axis=1)], 2).reshape(-1, 2), 1)
    return np.unique(edges, axis=0, return_counts=True)[1]


def require_sound(mesh, *, closed):
    assert mesh_defects(mesh, closed=closed) == []


@pytest.fixture(scope='module')
def closed():
    settings = MeshSettings(close='all', floor=None, voxel=0.8e-3)
    return build_mesh(CELL, views(), Poses.identity(2), settings)


def test_closed_mesh_is_sound(closed):
    require_sound(closed, closed=True)
    assert boundary_loops(closed.vertices_xyz, closed.faces) == []


def test_measured_vertices_lie_on_the_sphere(closed):
    seen = closed.vertices_xyz[np.isfinite(closed.sigma)]
    distance = SPHERE.distance(seen)
    assert np.percentile(np.abs(distance), 90) < 0.02e-3
    assert abs(np.median(distance)) < 0.008e-3


def test_open_mesh_has_only_measured_faces_and_reports_its_boundary_loops():
    mesh = build_mesh(CELL, views(), Poses.identity(2), MeshSettings(floor=None, voxel=1e-3))
    require_sound(mesh, closed=False)
    assert mesh.kind.max() < FILLED
    loops = boundary_loops(mesh.vertices_xyz, mesh.faces)
    assert sum(loop.edges for loop in loops) == (edge_counts(mesh) == 1).sum()
    # the pole below, which the camera does not see
    assert loops[0].center_xyz[2] < 0.02
    assert loops[0].length > 0.02


def test_faces_that_were_not_measured_are_marked(closed):
    middle = closed.vertices_xyz[closed.faces].mean(axis=1)
    seen = closed.vertices_xyz[np.isfinite(closed.sigma)]
    low = middle[:, 2] < seen[:, 2].min() - 0.5e-3
    assert low.any()
    assert (closed.kind[low] != MEASURED).all()
    assert (closed.kind == MEASURED).mean() > 0.7


def test_part_stands_on_a_flat_face_at_the_floor():
    settings = MeshSettings(close='all', floor=0.02, voxel=1e-3)
    mesh = build_mesh(CELL, views(), Poses.identity(2), settings)
    require_sound(mesh, closed=True)
    assert mesh.vertices_xyz[:, 2].min() == pytest.approx(0.02, abs=0.05e-3)


@pytest.mark.parametrize('seed', range(6))
def test_noise_and_gaps_leave_a_sound_mesh(seed):
    bad = [degrade(view, seed) for view in views(steps=40)]
    settings = MeshSettings(close='all', floor=None, voxel=1.2e-3, island=50)
    require_sound(build_mesh(CELL, bad, Poses.identity(2), settings), closed=True)


def test_smoothing_reduces_noise():
    noisy = [degrade(view, 3) for view in views()]
    left = []
    for rounds in (0, 8):
        settings = MeshSettings(smoothing=rounds, floor=None)
        mesh = build_mesh(CELL, noisy, Poses.identity(2), settings)
        distance = SPHERE.distance(mesh.vertices_xyz[np.isfinite(mesh.sigma)])
        left.append(np.percentile(np.abs(distance), 68))
    assert left[1] < left[0]
    assert left[1] < 0.35 * 0.04e-3 * 1.3


def test_repeated_points_make_the_same_mesh():
    (view,) = views(1, steps=40)
    again = replace(
        view,
        **{
            name: np.repeat(getattr(view, name), 6, axis=0 if name in {'angles', 'seqs'} else 1)
            for name in ('points_xyz', 'intensity', 'sigma', 'uv', 'angles', 'seqs')
        },
    )
    once = build_mesh(CELL, [view], Poses.identity(1), MeshSettings(floor=None))
    many = build_mesh(CELL, [again], Poses.identity(1), MeshSettings(floor=None))
    assert len(many.faces) == pytest.approx(len(once.faces), rel=0.1)
    assert np.abs(SPHERE.distance(many.vertices_xyz[np.isfinite(many.sigma)])).max() < 2e-3


@pytest.mark.parametrize('method', ['integrate', 'paper', 'poisson'])
def test_every_method_gives_the_sphere(method):
    mesh = build_mesh(CELL, views(), Poses.identity(2), MeshSettings(method=method, floor=None))
    assert len(mesh.faces) > 5000
    assert np.percentile(np.abs(SPHERE.distance(mesh.vertices_xyz)), 90) < 0.2e-3


@pytest.mark.parametrize('method', ['integrate', 'paper', 'poisson'])
def test_view_without_points_is_refused(method):
    (view,) = views(1)
    empty = without(view, np.ones(view.valid.shape, dtype=bool))
    with pytest.raises(GeometryError, match=r'^meshing: '):
        build_mesh(CELL, [empty], Poses.identity(1), MeshSettings(method=method))


def test_view_of_one_profile_is_refused():
    (view,) = views(1, steps=1)
    with pytest.raises(GeometryError, match='in neighboring profiles'):
        build_mesh(CELL, [view], Poses.identity(1))


def test_voxel_that_is_too_small_is_refused():
    with pytest.raises(ParameterError, match=r'voxel: 1e-05 mm is too small for a part of 50 x'):
        build_mesh(CELL, views(1), Poses.identity(1), MeshSettings(voxel=1e-8))


def test_island_larger_than_the_mesh_is_refused():
    with pytest.raises(GeometryError, match='no connected component has 10000000 triangles'):
        build_mesh(CELL, views(1), Poses.identity(1), MeshSettings(island=10_000_000))


@pytest.mark.parametrize(
    ('name', 'value'),
    [('method', 'magic'), ('close', 'some'), ('voxel', 0.0), ('voxel', np.nan), ('max_edge', -1),
     ('max_edge', 0.0), ('max_edge', 1.1), ('smoothing', 300), ('decimate', 1.0), ('island', -1),
     ('floor', np.nan)],
)  # fmt: skip
def test_setting_that_cannot_be_used_is_refused(name, value):
    with pytest.raises(ParameterError, match=f'^{name}: '):
        MeshSettings(**{name: value})


def test_close_is_refused_with_method_paper():
    with pytest.raises(ParameterError, match=r'close: .* is not available with method paper'):
        MeshSettings(method='paper', close='all')
