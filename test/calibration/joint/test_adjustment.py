# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from support.joint_scene import disturbed
from support.joint_scene import laser_error
from support.joint_scene import scene
from support.joint_scene import SceneSettings
from support.joint_scene import TARGET

from ivfmc_ros.calibration.joint.adjustment import JointProblem
from ivfmc_ros.calibration.joint.calibrate import result_of
from ivfmc_ros.calibration.joint.held_back import held_back_residuals
from ivfmc_ros.calibration.joint.observability import laser_plane_grid
from ivfmc_ros.calibration.joint.observability import weak_directions
from ivfmc_ros.calibration.joint.parameters import apply_step
from ivfmc_ros.calibration.joint.parameters import FreeJointParameters
from ivfmc_ros.calibration.joint.parameters import ParameterOrder
from ivfmc_ros.calibration.joint.prior import Prior
from ivfmc_ros.cell.volume import Volume
from ivfmc_ros.errors import CalibrationError

# the lens of the bench cell has k1 and k2 only
FREE = FreeJointParameters(square=True, fixed=(6, 7, 8), bend=False, free_corners=False)
SMALL = SceneSettings(boards=3, striped=2, turned=3, platter_stripes=1)


def problem_of(seen):
    return JointProblem(observations=seen, free=FREE, prior=Prior(TARGET))


def all_residuals(problem, state, order):
    found = problem.residuals(state, order)
    parts = (
        *found.boards,
        *(part for _, part in found.board_stripes),
        *found.platter,
        *found.platter_stripes,
    )
    return np.concatenate([part.values for part in parts]), parts


@pytest.fixture(scope='module')
def solved():
    """The scene and its adjustment from a disturbed start."""
    seen, true = scene(SceneSettings(boards=8, striped=6, turned=8, platter_stripes=2, seed=11))
    return seen, true, result_of(problem_of(seen), disturbed(true))


def test_jacobians_are_the_derivatives_of_the_residuals():
    seen, true = scene(SMALL)
    state, order, problem = disturbed(true), ParameterOrder.of(true), problem_of(seen)
    _, parts = all_residuals(problem, state, order)
    jacobian = np.vstack([part.common for part in parts])
    poses, angles = np.zeros_like(state.board_poses), np.zeros_like(state.axis.angles)
    for column in range(order.count):
        step = np.zeros(order.count)
        step[column] = 1e-3 if column < 4 else 1e-5
        ahead, behind = (
            all_residuals(problem, apply_step(state, order, s * step, poses, angles), order)[0]
            for s in (1, -1)
        )
        numeric = (behind - ahead) / (2 * step[column])
        off = np.abs(numeric - jacobian[:, column]).max()
        assert off <= 1e-3 * max(np.abs(numeric).max(), 1e-9), order.names()[column]


def test_adjustment_finds_the_true_cell(solved):
    _, true, result = solved
    cell = result.cell
    assert abs(cell.camera.K[0, 0] - true.camera.K[0, 0]) < 1.0
    T = true.axis.camera_from_base
    for found, laser in zip(cell.lasers, true.lasers, strict=True):
        grid = laser_plane_grid(T, laser.normal, laser.offset, Volume())
        assert laser_error(found, laser, grid) < 5e-5
    assert np.abs(cell.turntable.camera_from_base - T).max() < 2e-4
    assert result.rms['board_px'] == pytest.approx(0.03 * np.sqrt(2), rel=0.1)
    assert result.rms['board_px'] < result.steps_rms['board_px']


def test_covariance_states_the_error(solved):
    _, true, result = solved
    covariance = result.cell.covariance
    sigma = dict(zip(covariance.parameters, np.sqrt(np.diag(covariance.matrix)), strict=True))
    off = result.cell.camera.K[0, 0] - true.camera.K[0, 0]
    assert 0.01 < sigma['fx'] < 1.0
    assert abs(off) < 4 * sigma['fx']
    assert 1e-6 < result.worst_point_u < 1e-4
    # with a known camera the planes are known better
    known = np.diag(result.cell.lasers[0].covariance)
    assert known[3] < covariance.block(['left.d'])[0, 0]


def test_what_pictures_never_determine_is_named(solved):
    text = '\n'.join(solved[2].unobserved)
    assert 'scale' in text
    assert 'zero of the table angle' in text


def printed_larger(seen, true, factor):
    """Observations of a target that is larger by a factor than it is said to be."""
    corners, axis = seen.platter.corners, replace(true.axis, scale=factor)
    uv = corners.uv + true.camera.K[[0, 1], [0, 1]] * (
        _projected(axis, corners) - _projected(true.axis, corners)
    )
    pixels = true.camera.project(
        np.column_stack([uv / true.camera.K[[0, 1], [0, 1]], np.ones(len(uv))])
    )
    platter = replace(seen.platter, corners=replace(corners, uv=uv), pixels=pixels)
    return replace(seen, platter=platter)


def _projected(axis, corners):
    points = axis.corners_in_camera(corners)
    return points[:, :2] / points[:, 2:]


def test_lengths_that_agree_are_no_doubt(solved):
    check = solved[2].scale_check
    assert abs(check.difference) < 3 * check.u
    assert 1e-5 < check.u < 1e-3
    assert not check.is_doubtful


def test_length_of_the_platter_target_that_contradicts_the_board_is_found(solved):
    seen, true, right = solved
    found = result_of(problem_of(printed_larger(seen, true, 1.005)), true).scale_check
    assert found.is_doubtful
    # the prior of the adjustment pulls the ratio towards 1, the check does not
    assert found.difference - right.scale_check.difference == pytest.approx(0.005, rel=0.1)


def test_board_of_unknown_length_is_part_of_the_check(solved):
    seen, true, right = solved
    found = result_of(problem_of(seen), true, scale_u=1e-3).scale_check
    assert found.u == pytest.approx(np.hypot(right.scale_check.u, 1e-3), rel=0.05)


def test_without_a_stripe_on_the_platter_nothing_checks_the_scale(solved):
    seen, true, _ = solved
    assert result_of(problem_of(replace(seen, platter_stripes=())), true).scale_check is None


def test_weak_directions_are_named():
    bad = SceneSettings(
        boards=5, striped=2, turned=3, platter_stripes=0, corner_noise=1.0, stripe_noise=2.0
    )
    seen, true = scene(bad)
    weak = weak_directions(problem_of(seen).solve(true))
    assert weak
    assert all(one.displacement > 5e-5 and one.parameters for one in weak)
    assert [one.displacement for one in weak] == sorted(
        (one.displacement for one in weak), reverse=True
    )
    assert 'mm (1 sigma' in str(weak[0])


def test_held_back_residuals_are_those_of_the_noise(solved):
    _, true, result = solved
    other, _ = scene(SceneSettings(boards=3, striped=2, turned=3, platter_stripes=1, seed=77))
    found = held_back_residuals(result.adjusted.state, other)
    assert found.pictures == 3 + 2 * 2 + 3 + 2
    assert found.board == pytest.approx(0.03 * np.sqrt(2), rel=0.15)
    assert found.platter == pytest.approx(0.03 * np.sqrt(2), rel=0.15)
    assert found.board_stripe < 3e-5
    off = disturbed(true, seed=3)
    assert held_back_residuals(off, other).board_stripe > 2 * found.board_stripe


def test_stripe_on_something_else_is_refused_by_name(solved):
    seen, true, _ = solved
    first, *others = seen.platter_stripes
    moved = replace(first, stripe=replace(first.stripe, uv=first.stripe.uv + 150.0))
    wrong = replace(seen, platter_stripes=(moved, *others))
    with pytest.raises(CalibrationError, match=rf'folder: {first.name}: its stripe is'):
        result_of(problem_of(wrong), true, where='folder')


def test_adjustment_that_does_not_converge_is_refused(solved, monkeypatch):
    seen, true, _ = solved
    monkeypatch.setattr('ivfmc_ros.calibration.joint.adjustment._MAX_ITERATIONS', 1)
    with pytest.raises(CalibrationError, match='does not converge'):
        result_of(problem_of(seen), disturbed(true), where='folder')
