# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from support.surfaces import empty
from support.surfaces import moved
from support.surfaces import slip
from support.surfaces import wavy_view

from ivfmc_ros.cell import transforms
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.registration.align import align
from ivfmc_ros.registration.views.assemble import without

METHODS = ('paper', 'point_to_plane')


@pytest.mark.parametrize('method', METHODS)
def test_slip_between_views_is_found(method):
    # less than half the sampling: beyond it the paper's method matches the next point
    views = [wavy_view(0), moved(wavy_view(1), transforms.invert(slip(0.3, 0.1)))]
    poses, verdicts = align(views, method)
    assert np.array_equal(poses.turntable_from_view[0], np.eye(4))
    back = transforms.apply(poses.turntable_from_view[1], views[1].cloud())
    assert np.linalg.norm(back - wavy_view().cloud(), axis=1).max() < 1e-6
    verdict = verdicts[1]
    assert (verdict.view, verdict.applied, verdict.why) == (1, True, 'moved')
    assert verdict.overlap > 0.95
    assert verdict.rms_after < 1e-6 < verdict.rms_before
    assert np.degrees(verdict.rotation) == pytest.approx(0.3, abs=1e-3)
    assert verdict.translation == pytest.approx(1e-4, abs=1e-6)


def test_slip_is_found_where_the_views_have_other_points():
    source = wavy_view(1, offset=2e-4)
    views = [wavy_view(0), moved(source, transforms.invert(slip(0.4, 0.6)))]
    poses, verdicts = align(views, 'point_to_plane')
    back = transforms.apply(poses.turntable_from_view[1], views[1].cloud())
    assert np.linalg.norm(back - source.cloud(), axis=1).max() < 2e-5
    assert verdicts[1].applied
    assert verdicts[1].rms_after < 0.1 * verdicts[1].rms_before


def test_third_view_is_moved_onto_the_two_before_it():
    # the third one lies half on each of the others, and these do not touch
    whole = wavy_view(0, 120, 150)
    left, right = np.zeros((2, *whole.valid.shape), dtype=bool)
    left[:, 70:], right[:, :80] = True, True
    T = transforms.invert(slip(0.3, 0.2))
    views = [without(whole, left), replace(without(whole, right), number=1)]
    views.append(replace(moved(whole, T), number=2))
    poses, verdicts = align(views, 'point_to_plane')
    assert not verdicts[1].applied
    assert verdicts[2].applied
    assert verdicts[2].overlap > 0.9
    back = transforms.apply(poses.turntable_from_view[2], views[2].cloud())
    assert np.linalg.norm(back - whole.cloud(), axis=1).max() < 1e-5


@pytest.mark.parametrize('method', METHODS)
def test_table_is_kept_where_views_do_not_overlap(method):
    away = transforms.rigid(np.eye(3), (0.2, 0.0, 0.0))
    poses, verdicts = align([wavy_view(0), moved(wavy_view(1), away)], method)
    assert np.array_equal(poses.turntable_from_view, np.tile(np.eye(4), (2, 1, 1)))
    assert not verdicts[1].applied
    assert verdicts[1].why.startswith('not checked: ICP: only 0 points lie within 1.50 mm')
    assert verdicts[1].overlap == 0.0


def test_table_is_kept_where_little_overlaps():
    # a strip of a tenth of the view is shared, and a slip of 0.3 mm is in it
    hidden = np.zeros(wavy_view().valid.shape, dtype=bool)
    hidden[:, 15:] = True
    poses, verdicts = align([without(wavy_view(0), hidden), moved(wavy_view(1), slip())], 'paper')
    assert np.array_equal(poses.turntable_from_view[1], np.eye(4))
    assert not verdicts[1].applied
    assert 'overlap' in verdicts[1].why
    assert 0.0 < verdicts[1].overlap < 0.2


@pytest.mark.parametrize('method', METHODS)
def test_views_that_agree_stay_where_they_are(method):
    poses, verdicts = align([wavy_view(0), wavy_view(1), wavy_view(2)], method)
    assert np.allclose(poses.turntable_from_view, np.eye(4), atol=1e-9)
    assert [verdict.applied for verdict in verdicts] == [False] * 3
    assert verdicts[1].why == 'table pose kept: ICP does not improve the fit'
    assert verdicts[1].overlap == 1.0


@pytest.mark.parametrize('method', METHODS)
def test_round_part_does_not_spin(method):
    # a cylinder, scanned twice at other angles: its rotation is not observable
    height, angle = np.meshgrid(np.arange(60) * 5e-4, np.arange(90) * np.radians(2), indexing='ij')
    rng = np.random.default_rng(1)
    views = []
    for number, shift in ((0, 0.0), (1, np.radians(0.7))):
        radius = 0.02 + 1e-5 * rng.standard_normal(height.shape)
        x, y = radius * np.cos(angle + shift), radius * np.sin(angle + shift)
        view = wavy_view(number, 60, 90)
        views.append(replace(view, points_xyz=np.stack([x, y, height], axis=2)))
    poses, verdicts = align(views, method)
    assert np.array_equal(poses.turntable_from_view[1], np.eye(4))
    assert verdicts[1].why.startswith('table pose kept')


def test_method_table_keeps_the_poses_of_the_table():
    views = [wavy_view(0), moved(wavy_view(1), slip())]
    poses, verdicts = align(views, 'table')
    assert np.array_equal(poses.turntable_from_view, np.tile(np.eye(4), (2, 1, 1)))
    assert [verdict.why for verdict in verdicts] == ['reference', 'table pose kept, not checked']
    assert np.isnan(verdicts[1].rms_before)


@pytest.mark.parametrize('place', [0, 1, 2])
def test_empty_view_is_ignored(place):
    T = transforms.invert(slip(0.3, 0.2))
    views = [wavy_view(0), moved(wavy_view(1), T)]
    views.insert(place, empty(wavy_view(9)))
    poses, verdicts = align(views, 'point_to_plane')
    assert len(poses) == len(verdicts) == 3
    assert np.isfinite(poses.turntable_from_view).all()
    full = [k for k in range(3) if k != place]
    back = transforms.apply(poses.turntable_from_view[full[1]], views[full[1]].cloud())
    assert np.linalg.norm(back - wavy_view().cloud(), axis=1).max() < 1e-5
    assert not verdicts[place].applied


def test_single_view_is_the_reference():
    poses, verdicts = align([wavy_view(3)], 'point_to_plane')
    assert np.array_equal(poses.turntable_from_view, np.eye(4)[None])
    assert [(verdict.view, verdict.why) for verdict in verdicts] == [(3, 'reference')]


def test_no_views_no_poses():
    poses, verdicts = align([], 'point_to_plane')
    assert len(poses) == 0
    assert verdicts == []


def test_large_views_are_downsampled_without_losing_the_slip():
    true = slip()
    views = [wavy_view(0, 300, 300), moved(wavy_view(1, 300, 300), transforms.invert(true))]
    poses, _ = align(views, 'point_to_plane')
    back = transforms.apply(poses.turntable_from_view[1], views[1].cloud())
    assert np.linalg.norm(back - wavy_view(0, 300, 300).cloud(), axis=1).max() < 1e-5


def test_unknown_method_is_refused():
    with pytest.raises(ParameterError, match="registration: 'magic' is not one of table, paper"):
        align([wavy_view()], 'magic')
