# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the turntable accepts on joint_trajectory."""

import math

from builtin_interfaces.msg import Duration
import pytest
from trajectory_msgs.msg import JointTrajectory
from trajectory_msgs.msg import JointTrajectoryPoint

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.nodes.convert.joints import read_trajectory


def trajectory(position, sec=1):
    start = Duration(sec=sec, nanosec=500_000_000)
    point = JointTrajectoryPoint(positions=[position], time_from_start=start)
    return JointTrajectory(joint_names=['table'], points=[point])


def test_position_and_duration_are_read():
    assert read_trajectory(trajectory(-6.5), 'table') == (-6.5, 1.5)


@pytest.mark.parametrize('position', [math.inf, -math.inf, math.nan, 1e300, -1e5])
def test_position_that_is_none_is_refused(position):
    with pytest.raises(ParameterError, match='joint_trajectory: the position'):
        read_trajectory(trajectory(position), 'table')


def test_negative_duration_is_refused():
    with pytest.raises(ParameterError, match='time_from_start is negative'):
        read_trajectory(trajectory(1.0, sec=-2), 'table')
