# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ivfmc_ros.cell import transforms

ROTATION = Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix()


def test_positive_rotation_takes_x_to_y():
    assert transforms.rotation_z(np.pi / 2) @ [1, 0, 0] == pytest.approx([0, 1, 0], abs=1e-15)


def test_array_of_angles_gives_array_of_rotations():
    angles = np.array([0.0, 0.5, -2.0])
    many = transforms.rotation_z(angles)
    assert many.shape == (3, 3, 3)
    for angle, R in zip(angles, many, strict=True):
        assert np.array_equal(R, transforms.rotation_z(angle))


def test_inverse_times_matrix_is_identity():
    T = transforms.rigid(ROTATION, (0.1, -0.2, 0.4))
    assert np.allclose(transforms.invert(T) @ T, np.eye(4), atol=1e-15)
    points = np.random.default_rng(1).normal(size=(5, 4, 3))
    back = transforms.apply(transforms.invert(T), transforms.apply(T, points))
    assert np.allclose(back, points, atol=1e-14)


def test_apply_is_the_matrix_product():
    T = transforms.rigid(ROTATION, (0.1, -0.2, 0.4))
    point = np.array([0.3, 0.2, -0.1])
    assert transforms.apply(T, point[None])[0] == pytest.approx((T @ [*point, 1.0])[:3])


def test_rotations_are_recognized():
    assert transforms.is_rotation(ROTATION)


@pytest.mark.parametrize(
    'R',
    [
        -ROTATION,
        ROTATION @ np.diag([1, 1, -1]),
        ROTATION[:, [1, 0, 2]],
        1.001 * ROTATION,
        ROTATION + 1e-5,
        np.zeros((3, 3)),
        np.full((3, 3), np.nan),
    ],
    ids=['inverted', 'mirrored', 'swapped', 'scaled', 'skewed', 'zero', 'nan'],
)
def test_other_matrices_are_not_rotations(R):
    assert not transforms.is_rotation(R)
