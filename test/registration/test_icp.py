# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ivfmc_ros.cell import transforms
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.registration.icp import icp

METHODS = ('paper', 'point_to_plane')


def corner(count=4000, seed=1, noise=0.0):
    """Points on three faces of a 40 mm box, and their normals."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(0.0, 0.04, (count, 3))
    face = rng.integers(0, 3, count)
    points[np.arange(count), face] = 0.0
    normals = np.zeros((count, 3))
    normals[np.arange(count), face] = -1.0
    return points + noise * rng.standard_normal((count, 3)), normals


def moved_by(degrees=1.0, millimeters=0.6):
    rotation = Rotation.from_rotvec(np.radians(degrees) * np.array([0.6, -0.64, 0.48]))
    return transforms.rigid(rotation.as_matrix(), 1e-3 * millimeters * np.array([0.6, 0.0, -0.8]))


def error_of(T, truth, points):
    return np.linalg.norm(transforms.apply(T, points) - transforms.apply(truth, points), axis=1)


@pytest.mark.parametrize('method', METHODS)
def test_known_displacement_is_found_on_the_same_points(method):
    target, normals = corner()
    truth = moved_by()
    source = transforms.apply(transforms.invert(truth), target)
    found = icp(
        source,
        target,
        normals,
        np.eye(4),
        max_correspondence_distance=3e-3,
        method=method,
        iterations=200,
    )
    assert found.converged
    assert error_of(found.target_from_source, truth, source).max() < 1e-6
    assert found.overlap == 1.0
    assert found.correspondences == len(source)
    assert found.rms_before > 1e-4
    assert found.rms_after < 1e-6


@pytest.mark.parametrize(('method', 'tolerance'), [('paper', 2e-4), ('point_to_plane', 5e-6)])
def test_known_displacement_is_found_on_other_points_of_the_surface(method, tolerance):
    target, normals = corner(20_000)
    truth = moved_by(0.5, 0.4)
    other, _ = corner(5000, seed=2)
    source = transforms.apply(transforms.invert(truth), other)
    found = icp(
        source,
        target,
        normals,
        np.eye(4),
        max_correspondence_distance=2e-3,
        method=method,
        iterations=200,
    )
    assert error_of(found.target_from_source, truth, source).max() < tolerance
    assert found.rms_after < found.rms_before


def test_noise_averages_out():
    target, normals = corner(20_000, noise=3e-5)
    other, _ = corner(5000, seed=2, noise=3e-5)
    truth = moved_by(0.5, 0.4)
    source = transforms.apply(transforms.invert(truth), other)
    found = icp(source, target, normals, np.eye(4), max_correspondence_distance=2e-3)
    assert error_of(found.target_from_source, truth, source).max() < 1e-5
    # two clouds of 0.03 mm noise along the normal, without the worst tenth
    assert 2.5e-5 < found.rms_after < 5e-5


@pytest.mark.parametrize('method', METHODS)
def test_result_is_rigid(method):
    target, normals = corner()
    source = transforms.apply(moved_by(2.0), target)
    T = icp(
        source, target, normals, np.eye(4), max_correspondence_distance=3e-3, method=method
    ).target_from_source
    assert T.shape == (4, 4)
    assert transforms.is_rotation(T[:3, :3])
    assert T[3].tolist() == [0, 0, 0, 1]


def test_search_starts_at_the_initial_pose():
    target, normals = corner()
    truth = moved_by(40.0, 30.0)
    source = transforms.apply(transforms.invert(truth), target)
    near = moved_by(0.5, 0.2) @ truth
    found = icp(source, target, normals, near, max_correspondence_distance=3e-3)
    assert error_of(found.target_from_source, truth, source).max() < 1e-6
    assert found.rms_before < 1e-3


def test_overlap_is_the_share_of_the_source():
    target, normals = corner()
    source = np.concatenate([target[:1000], target[:3000] + 0.2])
    found = icp(source, target, normals, np.eye(4), max_correspondence_distance=1e-3)
    assert found.correspondences == 1000
    assert found.overlap == 0.25


@pytest.mark.parametrize('flip', [1.0, -1.0])
def test_sense_of_the_normals_does_not_matter(flip):
    target, normals = corner()
    truth = moved_by()
    source = transforms.apply(transforms.invert(truth), target)
    found = icp(source, target, flip * normals, np.eye(4), max_correspondence_distance=3e-3)
    assert error_of(found.target_from_source, truth, source).max() < 1e-6


def test_plane_that_does_not_constrain_stays_finite():
    rng = np.random.default_rng(1)
    target = np.column_stack([rng.uniform(0, 0.04, (2000, 2)), np.zeros(2000)])
    normals = np.tile([0.0, 0.0, 1.0], (2000, 1))
    source = target[:1000] + np.array([0.0, 0.0, 3e-4])
    found = icp(source, target, normals, np.eye(4), max_correspondence_distance=1e-3)
    T = found.target_from_source
    assert np.isfinite(T).all()
    assert np.abs(transforms.apply(T, source)[:, 2]).max() < 1e-5
    assert np.linalg.norm(T[:2, 3]) < 1e-3


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize('short', ['source', 'target'])
@pytest.mark.parametrize('count', [0, 29])
def test_few_points_are_refused(method, short, count):
    points, normals = corner()
    source, target = points, points
    if short == 'source':
        source = points[:count]
    else:
        target, normals = points[:count], normals[:count]
    with pytest.raises(GeometryError, match=f'ICP: the {short} has {count} points, 30 needed'):
        icp(source, target, normals, np.eye(4), max_correspondence_distance=1e-3, method=method)


@pytest.mark.parametrize('where', ['source', 'target'])
@pytest.mark.parametrize('value', [np.nan, np.inf])
def test_point_that_is_not_finite_is_refused(where, value):
    points, normals = corner(100)
    broken = points.copy()
    broken[7, 1] = value
    clouds = (broken, points) if where == 'source' else (points, broken)
    with pytest.raises(GeometryError, match='ICP: a point is not finite'):
        icp(*clouds, normals, np.eye(4), max_correspondence_distance=1e-3)


@pytest.mark.parametrize('method', METHODS)
def test_clouds_that_do_not_overlap_are_refused(method):
    points, normals = corner()
    with pytest.raises(GeometryError, match=r'only 0 points lie within 1\.00 mm'):
        icp(
            points + 0.1,
            points,
            normals,
            np.eye(4),
            max_correspondence_distance=1e-3,
            method=method,
        )


def test_unknown_method_is_refused():
    points, normals = corner(100)
    with pytest.raises(
        ParameterError, match="method: 'magic' is not one of paper, point_to_plane"
    ):
        icp(points, points, normals, np.eye(4), max_correspondence_distance=1e-3, method='magic')
