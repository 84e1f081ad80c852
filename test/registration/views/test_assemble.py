# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace
import warnings

import numpy as np
import pytest
from support.synthetic import make_profile
from support.synthetic import small_cell
from support.synthetic import Sphere
from support.synthetic import sphere_profiles

from ivfmc_ros.errors import GeometryError
from ivfmc_ros.model import View
from ivfmc_ros.registration.views import assemble as sweeps

SPHERE = Sphere(np.array([0.006, 0.003, 0.045]), 0.02)


def grid_view(points_xyz, angles=None):
    """A view from a (rows, columns, 3) grid of points."""
    points = np.asarray(points_xyz, dtype=np.float64)
    columns = points.shape[1]
    values = np.where(np.isfinite(points[..., 0]), 1e-5, np.nan)
    return View(
        number=0,
        laser=0,
        points_xyz=points,
        intensity=values * 1e7,
        sigma=values,
        uv=np.repeat(values[..., None], 2, axis=2),
        angles=np.linspace(0.0, 0.1, columns) if angles is None else np.asarray(angles),
        seqs=np.arange(columns),
    )


def sheet(rows=6, columns=8, step=1e-3):
    """A flat grid with equal steps."""
    y, x = np.meshgrid(np.arange(rows) * step, np.arange(columns) * step, indexing='ij')
    return np.stack([x, y, np.zeros_like(x)], axis=2)


def turn(columns):
    return np.arange(columns) * 2.0 * np.pi / columns


def test_profiles_become_columns_in_the_order_of_their_angles():
    profiles = sphere_profiles(small_cell(), SPHERE, 12)
    shuffled = [profiles[k] for k in np.random.default_rng(1).permutation(12)]
    (view,) = sweeps.assemble(small_cell(), shuffled)
    assert view.points_xyz.shape == (512, 12, 3)
    assert view.seqs.tolist() == list(range(12))
    assert (np.diff(view.angles) > 0).all()
    for column, profile in enumerate(profiles):
        rows = np.round(profile.uv[:, 1]).astype(int)
        assert np.array_equal(view.points_xyz[rows, column], profile.points_xyz)
        assert np.array_equal(view.sigma[rows, column], profile.sigma)
        assert np.array_equal(view.uv[rows, column], profile.uv)
        assert np.count_nonzero(view.valid[:, column]) == len(profile)


def test_view_of_more_than_a_turn_is_cut_to_a_full_turn():
    angles = np.arange(27) * 2.0 * np.pi / 24
    view = replace(grid_view(sheet(columns=27), angles), color=np.zeros((6, 27, 3), np.uint8))
    assert not sweeps.is_full_turn(view)
    turn = sweeps.within_one_turn(view)
    assert sweeps.is_full_turn(turn)
    assert np.array_equal(turn.angles, angles[:24])
    assert np.array_equal(turn.points_xyz, view.points_xyz[:, :24])
    assert turn.color.shape == (6, 24, 3)
    assert sweeps.within_one_turn(turn) is turn


def test_what_is_not_measured_is_nan():
    (view,) = sweeps.assemble(small_cell(), sphere_profiles(small_cell(), SPHERE, 5))
    gone = ~view.valid
    assert 0 < gone.sum() < gone.size
    for values in (view.points_xyz, view.intensity, view.sigma, view.uv):
        assert np.isnan(values[gone]).all()
        assert np.isfinite(values[view.valid]).all()


def test_stripe_along_columns_fills_one_row_per_image_column():
    cell = small_cell()
    cell = replace(cell, lasers=(replace(cell.lasers[0], stripe='columns'),))
    uv = np.array([[600.0, 17.3], [601.0, 17.4]])
    (view,) = sweeps.assemble(cell, [make_profile(np.ones((2, 3)), uv=uv)])
    assert view.points_xyz.shape == (640, 1, 3)
    assert np.flatnonzero(view.valid[:, 0]).tolist() == [600, 601]


def test_views_come_in_the_order_of_their_numbers():
    numbers = [4, 1, 4, 0]
    profiles = [
        make_profile(np.zeros((3, 3)), view=view, laser=view % 2, angle=0.1 * k)
        for k, view in enumerate(numbers)
    ]
    views = sweeps.assemble(small_cell(), profiles)
    assert [view.number for view in views] == [0, 1, 4]
    assert [len(view.angles) for view in views] == [1, 1, 2]
    assert [view.laser for view in views] == [0, 1, 0]


def test_two_lasers_in_a_view_are_refused():
    profiles = [make_profile(np.zeros((3, 3)), view=2, laser=laser) for laser in (0, 1)]
    with pytest.raises(GeometryError, match=r'view 2: has profiles of lasers \[0, 1\]'):
        sweeps.assemble(small_cell(), profiles)


def test_no_profile_no_view():
    assert sweeps.assemble(small_cell(), []) == []


def test_empty_profiles_keep_their_columns():
    nothing = np.empty((0, 3))
    profiles = [make_profile(nothing, angle=angle) for angle in (0.0, 0.1)]
    (view,) = sweeps.assemble(small_cell(), profiles)
    assert view.points_xyz.shape == (512, 2, 3)
    assert not view.valid.any()
    assert view.cloud().shape == (0, 3)


@pytest.mark.parametrize(
    ('angles', 'expected'),
    [
        (turn(60), True),
        (turn(60) + 1.0, True),
        (turn(60)[:-3], True),  # a table that loses a few steps
        (turn(60)[:45], False),
        (np.append(turn(60), 2.0 * np.pi), True),
        (np.linspace(0.0, 3.0 * np.pi, 90), False),
        ([0.0, 3.1], False),
        ([0.0], False),
        ([], False),
    ],
)
def test_full_turn_is_recognized(angles, expected):
    points = np.zeros((2, len(angles), 3))
    assert sweeps.is_full_turn(grid_view(points, angles)) is expected


def test_spacing_is_the_coarser_of_both_directions():
    assert sweeps.spacing(grid_view(sheet() * [1.0, 0.3, 1.0])) == pytest.approx(1e-3)
    assert sweeps.spacing(grid_view(sheet() * [0.3, 1.0, 1.0])) == pytest.approx(1e-3)


def test_jump_does_not_change_the_spacing():
    points = sheet(8, 8)
    points[:, 4:, 2] += 0.05
    assert sweeps.spacing(grid_view(points)) == pytest.approx(1e-3)


def test_spacing_of_one_row_or_column_is_that_of_the_other():
    assert sweeps.spacing(grid_view(sheet(1, 5))) == pytest.approx(1e-3)
    assert sweeps.spacing(grid_view(sheet(5, 1))) == pytest.approx(1e-3)


def test_spacing_of_nothing_is_nan_without_a_warning():
    lonely = np.full((5, 5, 3), np.nan)
    lonely[2, 2] = 0.0
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        assert np.isnan(sweeps.spacing(grid_view(np.full((4, 4, 3), np.nan))))
        assert np.isnan(sweeps.spacing(grid_view(lonely)))
        assert np.isnan(sweeps.spacing(grid_view(sheet(1, 1))))


def test_removed_points_are_nan_in_all_that_belongs_to_them():
    view = grid_view(sheet())
    removed = np.zeros(view.valid.shape, dtype=bool)
    removed[2, 3] = True
    left = sweeps.without(view, removed)
    for values in (left.points_xyz, left.intensity, left.sigma, left.uv):
        assert np.isnan(values[2, 3]).all()
        assert np.isfinite(values[~removed]).all()
    assert view.valid.all()


def test_flying_points_are_found():
    points = sheet(10, 10)
    points[4:6, 4:6, 2] += 0.01
    points[0, 9] = np.nan
    found = sweeps.flying_points(grid_view(points), 2e-3, 5)
    assert np.argwhere(found).tolist() == [[4, 4], [4, 5], [5, 4], [5, 5]]
    assert not sweeps.flying_points(grid_view(points), 2e-3, 4).any()


def test_diagonal_neighbors_are_connected():
    points = np.full((6, 6, 3), np.nan)
    points[:3, :3] = sheet(3, 3)
    points[3:, 3:] = sheet(6, 6)[3:, 3:]
    assert not sweeps.flying_points(grid_view(points), 2e-3, 18).any()
    assert sweeps.flying_points(grid_view(points), 1.2e-3, 18).sum() == 18


def test_component_across_the_seam_of_a_full_turn_is_connected():
    columns = 24
    angles = turn(columns)
    ring = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1) * 0.02
    points = np.repeat(ring[None], 4, axis=0) + (np.arange(4)[:, None, None] * [0, 0, 1e-3])
    points[:, 3:-3] = np.nan
    closed = grid_view(points, angles)
    assert not sweeps.flying_points(closed, 8e-3, 24).any()
    # the same points in a sweep that does not close are two pieces
    open_sweep = grid_view(points, angles * 0.6)
    assert sweeps.flying_points(open_sweep, 8e-3, 24).sum() == 24


def test_empty_view_has_no_flying_points():
    assert not sweeps.flying_points(grid_view(np.full((4, 4, 3), np.nan)), 1e-3, 5).any()
    assert sweeps.flying_points(grid_view(sheet(1, 3)), 2e-3, 4).all()


def test_grid_normals_are_those_of_the_sphere():
    (view,) = sweeps.assemble(small_cell(), sphere_profiles(small_cell(), SPHERE, 90))
    normals = sweeps.grid_normals(view)
    known = np.isfinite(normals[..., 0])
    assert known.sum() > 0.8 * view.valid.sum()
    assert np.linalg.norm(normals[known], axis=1) == pytest.approx(np.ones(known.sum()))
    true = (view.points_xyz[known] - SPHERE.center) / SPHERE.radius
    cosine = np.abs((normals[known] * true).sum(axis=1))
    assert np.degrees(np.arccos(np.clip(np.percentile(cosine, 5), -1, 1))) < 3.0
    # the first and the last column are neighbors
    assert known[:, 0].any()
    assert known[:, -1].any()


@pytest.mark.parametrize('shape', [(1, 5), (5, 1), (1, 1), (2, 2)])
def test_grid_without_neighbors_has_no_normals(shape):
    assert np.isnan(sweeps.grid_normals(grid_view(sheet(*shape)))).all()
