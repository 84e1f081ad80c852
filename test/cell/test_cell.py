# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from support.synthetic import small_cell

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell import is_visible
from ivfmc_ros.cell.cell import Turntable
from ivfmc_ros.cell.laser import LaserPlane
from ivfmc_ros.errors import CellError

POSE = small_cell().turntable.camera_from_base


def pose(**changes):
    T = POSE.copy()
    for key, value in changes.items():
        T[int(key[1]), int(key[2])] = value
    return T


def test_to_camera_and_to_part_are_inverse():
    table = Turntable(camera_from_base=POSE)
    points = np.random.default_rng(1).uniform(-0.05, 0.05, (50, 3))
    for angle in (0.0, 1.0, -2.5, 7.0):
        seen = table.to_camera(points, angle)
        assert (seen[:, 2] > 0.3).all()
        assert np.allclose(table.to_part(seen, angle), points, atol=1e-15)


def test_point_seen_at_an_angle_is_at_minus_the_angle_in_the_part():
    # the table has turned by a, so what the camera meets at azimuth 0 was at azimuth -a
    table = Turntable(camera_from_base=POSE)
    seen = (POSE @ [0.05, 0.0, 0.02, 1.0])[None, :3]
    x, y, z = table.to_part(seen, np.radians(30.0))[0]
    assert np.degrees(np.arctan2(y, x)) == pytest.approx(-30.0)
    assert (np.hypot(x, y), z) == pytest.approx((0.05, 0.02))


def test_part_turns_counter_clockwise():
    table = Turntable(camera_from_base=transforms.rigid(np.eye(3), (0.0, 0.0, 0.4)))
    turned = table.to_camera(np.array([[0.05, 0.0, 0.0]]), np.radians(90.0))
    assert turned[0] == pytest.approx([0.0, 0.05, 0.4], abs=1e-15)


def test_empty_array_of_points_stays_empty():
    assert Turntable(camera_from_base=POSE).to_part(np.empty((0, 3)), 1.0).shape == (0, 3)


@pytest.mark.parametrize(
    ('matrix', 'problem'),
    [
        (np.eye(3), 'the last row'),
        (pose(_30=1e-9), 'the last row'),
        (pose(_33=2.0), 'the last row'),
        (POSE @ np.diag([-1.0, 1, 1, 1]), 'reflected'),
        (POSE @ np.diag([1.01, 1, 1, 1]), 'not orthonormal'),
        (pose(_00=POSE[0, 0] + 1e-4), 'not orthonormal'),
        (pose(_00=np.nan), 'not orthonormal'),
        (pose(_13=np.nan), '16 finite numbers'),
        (pose(_23=np.inf), '16 finite numbers'),
        (pose(_23=-0.4), 'behind the camera'),
    ],
    ids=[
        '3x3',
        'row',
        'scale',
        'reflected',
        'stretched',
        'skewed',
        'nan',
        'nowhere',
        'far',
        'behind',
    ],
)
def test_impossible_turntable_is_refused(matrix, problem):
    with pytest.raises(CellError, match=f'camera_from_base: .*{problem}'):
        Turntable(camera_from_base=matrix)


def test_cell_without_laser_is_refused():
    with pytest.raises(CellError, match='lasers: at least one'):
        replace(small_cell(), lasers=())


def test_two_lasers_of_one_name_are_refused():
    left = small_cell().lasers[0]
    with pytest.raises(CellError, match=r'lasers: two have the same name \(left, left\)'):
        replace(small_cell(), lasers=(left, left))


def test_plane_behind_the_camera_is_refused():
    behind = LaserPlane(name='back', normal=np.array([0.0, 0.0, 1.0]), offset=0.4)
    with pytest.raises(CellError, match='lasers: back: plane: the camera cannot see it'):
        replace(small_cell(), lasers=(behind,))


def test_plane_beside_the_picture_is_refused():
    # parallel to the view axis and 10 m aside: it enters the picture beyond 20 m
    aside = LaserPlane(name='far', normal=np.array([1.0, 0.0, 0.0]), offset=-10.0)
    with pytest.raises(CellError, match='lasers: far: plane: the camera cannot see it'):
        replace(small_cell(), lasers=(aside,))


def test_visible_planes_are_accepted():
    cell = small_cell()
    assert all(is_visible(cell.camera, laser) for laser in cell.lasers)
