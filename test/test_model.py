# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import FrozenInstanceError
from dataclasses import replace
import re

import numpy as np
import pytest

from ivfmc_ros.model import Frame
from ivfmc_ros.model import Mesh
from ivfmc_ros.model import Poses
from ivfmc_ros.model import Profile
from ivfmc_ros.model import View


def frame(image):
    return Frame(image=image, stamp_ns=0, angle=0.0)


def profile(count=4, **changes):
    values = {
        'points_xyz': np.zeros((count, 3)),
        'intensity': np.zeros(count),
        'sigma': np.zeros(count),
        'uv': np.zeros((count, 2)),
    }
    return Profile(**{**values, **changes}, angle=0.0, laser=0, view=0, seq=0, stamp_ns=0)


def view(rows=3, columns=5, **changes):
    values = {
        'points_xyz': np.zeros((rows, columns, 3)),
        'intensity': np.zeros((rows, columns)),
        'sigma': np.zeros((rows, columns)),
        'uv': np.zeros((rows, columns, 2)),
        'angles': np.zeros(columns),
        'seqs': np.zeros(columns, dtype=np.int64),
    }
    return View(**{**values, **changes}, number=0, laser=0)


def mesh(count=4, **changes):
    values = {
        'vertices_xyz': np.zeros((count, 3)),
        'faces': np.zeros((2, 3), dtype=np.int64),
        'normals': np.zeros((count, 3)),
        'sigma': np.zeros(count),
        'intensity': np.zeros(count),
    }
    return Mesh(**{**values, **changes})


@pytest.mark.parametrize('shape', [(4, 5), (4, 5, 3)])
@pytest.mark.parametrize('depth', ['uint8', 'uint16'])
def test_pictures_of_cameras_are_taken(shape, depth):
    assert frame(np.zeros(shape, dtype=depth)).image.shape == shape


@pytest.mark.parametrize('shape', [(4,), (4, 5, 1), (4, 5, 4), (2, 4, 5, 3)])
def test_picture_of_another_shape_is_refused(shape):
    with pytest.raises(ValueError, match=rf'image has shape {re.escape(str(shape))}'):
        frame(np.zeros(shape, dtype=np.uint8))


@pytest.mark.parametrize('kind', ['float64', 'int32', 'bool'])
def test_picture_of_other_numbers_is_refused(kind):
    with pytest.raises(ValueError, match=f'image has pixels of {kind}, expected uint8 or uint16'):
        frame(np.zeros((4, 5), dtype=kind))


@pytest.mark.parametrize(
    ('make', 'name', 'shape', 'expected'),
    [
        (profile, 'points_xyz', (4, 2), '(4, 3)'),
        (profile, 'intensity', (5,), '(4)'),
        (profile, 'sigma', (4, 1), '(4)'),
        (profile, 'uv', (4, 3), '(4, 2)'),
        (view, 'points_xyz', (3, 5), '(n, n, 3)'),
        (view, 'intensity', (5, 3), '(3, 5)'),
        (view, 'sigma', (3, 4), '(3, 5)'),
        (view, 'uv', (3, 5, 3), '(3, 5, 2)'),
        (view, 'angles', (3,), '(5)'),
        (view, 'seqs', (6,), '(5)'),
        (mesh, 'vertices_xyz', (4, 2), '(4, 3)'),
        (mesh, 'faces', (2, 4), '(n, 3)'),
        (mesh, 'normals', (2, 3), '(4, 3)'),
        (mesh, 'sigma', (3,), '(4)'),
        (mesh, 'intensity', (4, 1), '(4)'),
    ],
)
def test_array_of_another_shape_is_refused(make, name, shape, expected):
    message = re.escape(f'{name} has shape {shape}, expected {expected}')
    with pytest.raises(ValueError, match=message):
        make(**{name: np.zeros(shape)})


@pytest.mark.parametrize('shape', [(4, 4), (2, 3, 4), (2, 4, 3)])
def test_poses_of_another_shape_are_refused(shape):
    with pytest.raises(ValueError, match='turntable_from_view has shape'):
        Poses(turntable_from_view=np.zeros(shape))


def test_identity_moves_nothing():
    poses = Poses.identity(3)
    assert len(poses) == 3
    assert np.array_equal(poses.turntable_from_view[2], np.eye(4))
    assert len(Poses.identity(0)) == 0


def test_cloud_of_a_view_is_its_valid_points():
    points = np.arange(45.0).reshape(3, 5, 3)
    points[1, 2] = np.nan
    seen = view(points_xyz=points)
    assert seen.valid.sum() == 14
    assert np.array_equal(seen.cloud(), np.delete(points.reshape(-1, 3), 7, axis=0))


def test_length_of_a_profile_is_its_points():
    assert len(profile(4)) == 4
    assert len(profile(0)) == 0


def test_what_flows_cannot_be_changed():
    for thing, name in ((profile(), 'angle'), (view(), 'number'), (mesh(), 'faces')):
        with pytest.raises(FrozenInstanceError):
            setattr(thing, name, 1)
    assert replace(profile(), angle=1.0).angle == 1.0
