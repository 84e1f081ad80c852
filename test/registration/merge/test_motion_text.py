# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ivfmc_ros.cell import transforms
from ivfmc_ros.registration.merge.motion_text import describe_free_motion
from ivfmc_ros.registration.merge.motion_text import describe_motion


def about(axis, degrees, point, along=0.0):
    axis = np.array(axis, dtype=float)
    R = Rotation.from_rotvec(np.radians(degrees) * axis).as_matrix()
    return transforms.rigid(R, point - R @ point + along * axis)


@pytest.mark.parametrize(
    ('T', 'text'),
    [
        (
            about((0, 0, 1), 60, np.array([0.01, 0.02, 0.0])),
            'a turn by 60.0 degrees about the axis (0.00, 0.00, 1.00) through '
            '(10.0, 20.0, 0.0) mm',
        ),
        (
            about((0, 0, -1), 60, np.zeros(3)),
            'a turn by -60.0 degrees about the axis (0.00, 0.00, 1.00) through (0.0, 0.0, 0.0) mm',
        ),
        (
            about((-1, 0, 0), 180, np.array([0.0, 0.0, 0.03])),
            'a turn by 180.0 degrees about the axis (1.00, 0.00, 0.00) through '
            '(0.0, 0.0, 30.0) mm',
        ),
        (
            about((0, 1, 0), 90, np.zeros(3), 0.002),
            'a turn by 90.0 degrees about the axis (0.00, 1.00, 0.00) through (0.0, 0.0, 0.0) mm '
            'and a shift of 2.00 mm',
        ),
        (transforms.rigid(np.eye(3), (0, 0.005, 0)), 'a shift by (0.00, 5.00, 0.00) mm'),
    ],
)
def test_motion_is_described(T, text):
    assert describe_motion(T) == text


def test_free_motions_are_described():
    assert (
        describe_free_motion(np.array([0, 0, 20.0, 0, -0.2, 0]))
        == 'any turn about the axis (0.00, 0.00, 1.00) through (10.0, 0.0, 0.0) mm'
    )
    assert (
        describe_free_motion(np.array([0, 0, 0.01, 0, 0.7, 0]))
        == 'any shift along (0.00, 1.00, 0.00)'
    )
