# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest

pytest.importorskip('rclpy')

from ivfmc_ros.errors import MessageError
from ivfmc_ros.model import Profile
from ivfmc_ros.nodes.convert import clouds
from ivfmc_ros.storage.messages.profile_header import read_profile_header


def message(points_xyz):
    count = len(points_xyz)
    values = np.ones(count)
    profile = Profile(
        points_xyz=points_xyz, uv=np.ones((count, 2)), intensity=values, sigma=values,
        angle=0.5, laser=1, view=2, seq=3, stamp_ns=5_000_000_007, speed=0.25,
    )  # fmt: skip
    return clouds.from_profile(profile)


def test_header_is_that_of_the_profile():
    found = read_profile_header(message(np.tile([0.03, 0.04, 0.01], (50, 1))))
    assert (found.seq, found.view, found.laser, found.points) == (3, 2, 1, 50)
    assert (found.angle, found.speed, found.stamp_ns) == (0.5, 0.25, 5_000_000_007)
    assert found.reach == pytest.approx(0.05)


def test_stray_point_is_not_the_reach_of_the_part():
    points = np.tile([0.03, 0.04, 0.01], (200, 1))
    points[7] = 0.5, 0.0, 0.0
    assert read_profile_header(message(points)).reach == pytest.approx(0.05)
    points[:100] = 0.06, 0.08, 0.0
    assert read_profile_header(message(points)).reach == pytest.approx(0.1)


def test_profile_without_a_stripe_has_no_reach():
    found = read_profile_header(message(np.zeros((0, 3))))
    assert (found.points, found.reach) == (0, 0.0)
    assert math.isfinite(found.angle)


@pytest.mark.parametrize(
    ('name', 'changes'),
    [('point_step', {'point_step': 0}), ('point_step', {'point_step': 7}), ('offset', {})],
)
def test_damaged_layout_is_refused(name, changes):
    cloud = message(np.tile([0.03, 0.04, 0.01], (50, 1)))
    for key, value in changes.items():
        setattr(cloud, key, value)
    if name == 'offset':
        cloud.fields[1].offset = 4_000_000_000
    with pytest.raises(MessageError, match='do not fit into points of'):
        read_profile_header(cloud)


def test_points_that_are_announced_but_not_there_are_not_read():
    cloud = message(np.tile([0.03, 0.04, 0.01], (50, 1)))
    cloud.width = 4_000_000_000
    assert read_profile_header(cloud).reach == pytest.approx(0.05)
