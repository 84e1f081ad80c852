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
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.registration.align import align
from ivfmc_ros.registration.solver.gauss_newton import pose_vector
from ivfmc_ros.registration.solver.prior import TablePrior
from ivfmc_ros.registration.views.assemble import without

IDENTITY = np.eye(4)


def cylinder(number, shift, seed=1, radius=0.02):
    """Half a cylinder, turned by ``shift`` radians against its sampling, with 0.01 mm noise."""
    height, angle = np.meshgrid(np.arange(60) * 5e-4, np.arange(90) * np.radians(2), indexing='ij')
    noise = 1e-5 * np.random.default_rng((seed, number)).standard_normal(height.shape)
    x, y = (radius + noise) * np.cos(angle + shift), (radius + noise) * np.sin(angle + shift)
    return replace(wavy_view(number, 60, 90), points_xyz=np.stack([x, y, height], axis=2))


def plate(number, seed=1):
    noise = 1e-5 * np.random.default_rng((seed, number)).standard_normal((60, 90))
    y, z = np.meshgrid(np.arange(90) * 5e-4, np.arange(60) * 5e-4)
    return replace(wavy_view(number, 60, 90), points_xyz=np.stack([noise, y - 0.02, z], axis=2))


def test_slip_is_found_where_the_views_have_other_points():
    source = wavy_view(1, offset=2e-4)
    views = [wavy_view(0), moved(source, transforms.invert(slip(0.4, 0.3)))]
    poses, (reference, verdict) = align(views, 'joint')
    back = transforms.apply(poses.turntable_from_view[1], views[1].cloud())
    assert np.linalg.norm(back - source.cloud(), axis=1).max() < 1e-6
    assert (reference.why, verdict.why, verdict.applied) == ('reference', 'moved', True)
    assert verdict.converged
    assert verdict.overlap > 0.95
    assert verdict.rms_after < 0.01 * verdict.rms_before
    assert verdict.sigmas == pytest.approx(2.0, abs=0.05)
    assert verdict.free == 0


def test_all_views_are_solved_at_once():
    # a ring of four parts, each overlapping the next; only the first is where it belongs
    whole = wavy_view(0, 120, 160)
    truth, views = [IDENTITY, slip(0.2, 0.1), slip(-0.1, 0.15), slip(0.15, -0.1)], []
    for number, T in enumerate(truth):
        hidden = np.ones(whole.valid.shape, dtype=bool)
        hidden[:, 30 * number : 30 * number + 70] = False
        views.append(replace(moved(without(whole, hidden), transforms.invert(T)), number=number))
    poses, verdicts = align(views, 'joint')
    assert [verdict.applied for verdict in verdicts] == [False, True, True, True]
    for found, T in zip(poses.turntable_from_view, truth, strict=True):
        assert np.abs(found - T).max() < 3e-5


def test_views_that_agree_stay_where_they_are():
    poses, verdicts = align([wavy_view(0), wavy_view(1), wavy_view(2)], 'joint')
    assert np.array_equal(poses.turntable_from_view, np.tile(IDENTITY, (3, 1, 1)))
    assert [verdict.why for verdict in verdicts[1:]] == [
        'table pose kept: the views agree within their noise'
    ] * 2


def test_cylinder_does_not_spin_but_is_centred():
    T = transforms.rigid(transforms.rotation_z(np.radians(0.2)), (1e-4, -5e-5, 0.0))
    poses, verdicts = align([cylinder(0, 0.0), moved(cylinder(1, 0.007), T)], 'joint')
    found = pose_vector(poses.turntable_from_view[1])
    # its axis is corrected; rotation about it and translation along it are not observable
    axis = transforms.apply(poses.turntable_from_view[1] @ T, np.array([[0.0, 0.0, 0.015]]))[0]
    assert np.abs(axis[:2]).max() < 3e-6
    assert abs(found[2]) < np.radians(0.01)
    assert abs(found[5]) < 2e-6
    assert verdicts[1].applied
    assert verdicts[1].free >= 2


def test_plate_slides_neither_along_itself_nor_turns_in_its_plane():
    T = transforms.rigid(np.eye(3), (6e-5, 1e-4, 3e-5))
    poses, verdicts = align([plate(0), moved(plate(1), T)], 'joint')
    found = pose_vector(poses.turntable_from_view[1])
    assert found[3] == pytest.approx(-6e-5, abs=3e-6)
    assert np.abs(found[4:]).max() < 2e-6
    assert verdicts[1].free >= 3


def test_noise_alone_moves_no_view():
    poses, _ = align([cylinder(0, 0.0), cylinder(1, 0.007), cylinder(2, 0.013)], 'joint')
    assert np.array_equal(poses.turntable_from_view, np.tile(IDENTITY, (3, 1, 1)))


def test_views_that_do_not_overlap_are_not_checked():
    away = transforms.rigid(np.eye(3), (0.2, 0.0, 0.0))
    poses, verdicts = align([wavy_view(0), moved(wavy_view(1), away)], 'joint')
    assert np.array_equal(poses.turntable_from_view, np.tile(IDENTITY, (2, 1, 1)))
    assert [verdict.why for verdict in verdicts] == [
        'not checked: overlaps with no other view'
    ] * 2
    assert not any(verdict.checked for verdict in verdicts)


def test_identical_views_do_not_make_the_problem_singular():
    poses, _ = align([wavy_view(0), replace(wavy_view(0), number=1)], 'joint')
    assert np.array_equal(poses.turntable_from_view[1], IDENTITY)


@pytest.mark.parametrize('place', [0, 1, 2])
def test_empty_view_is_ignored(place):
    views = [wavy_view(0), moved(wavy_view(1), transforms.invert(slip(0.3, 0.2)))]
    views.insert(place, empty(wavy_view(9)))
    poses, verdicts = align(views, 'joint')
    assert verdicts[place].why == 'not checked: only 0 surfels'
    assert np.array_equal(poses.turntable_from_view[place], IDENTITY)
    assert verdicts[max(k for k in range(3) if k != place)].applied


def test_view_of_ten_points_is_ignored():
    few = np.ones(wavy_view().valid.shape, dtype=bool)
    few[0, :10] = False
    poses, verdicts = align([wavy_view(0), without(wavy_view(1), few)], 'joint')
    assert verdicts[1].why.startswith('not checked: only 0 surfels')
    assert len(poses) == 2


def test_no_views_and_single_views_need_no_registration():
    assert align([], 'joint')[1] == []
    assert align([wavy_view(3)], 'joint')[1][0].why == 'reference'


def test_prior_of_zero_allows_nothing():
    prior = TablePrior(angle=0.0, tilt=0.0, offset=0.0, height=0.0)
    poses, verdicts = align([wavy_view(0), moved(wavy_view(1), slip())], 'joint', prior=prior)
    assert np.array_equal(poses.turntable_from_view[1], IDENTITY)
    assert verdicts[1].why == 'table pose kept: the prior allows no correction'


def test_implausible_correction_is_rejected():
    prior = TablePrior(angle=np.radians(0.06), offset=1e-4)
    poses, verdicts = align(
        [wavy_view(0), moved(wavy_view(1), slip(0.4, 0.1))], 'joint', prior=prior
    )
    assert np.array_equal(poses.turntable_from_view[1], IDENTITY)
    assert "sigmas of the table's prior" in verdicts[1].why


@pytest.mark.parametrize('value', [-1e-3, np.nan, np.inf])
def test_prior_that_is_not_a_standard_deviation_is_refused(value):
    with pytest.raises(ParameterError, match=r'prior: offset: .* is not a standard deviation'):
        TablePrior(offset=value)


def test_points_in_millimetres_are_refused():
    with pytest.raises(GeometryError, match='view 1: has points farther than 100 m'):
        far = replace(wavy_view(1), points_xyz=1e4 * wavy_view().points_xyz)
        align([wavy_view(0), far], 'joint')


@pytest.mark.parametrize('value', [np.nan, np.inf])
def test_partly_finite_point_is_refused_by_the_number_of_its_view(value):
    views = [wavy_view(0), wavy_view(1, offset=1e-3)]
    views[1].points_xyz[40, 50, 2] = value
    with pytest.raises(GeometryError, match='view 1: has points of which some coordinates'):
        align(views, 'joint')
