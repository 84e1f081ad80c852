# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The environment of a process that runs a node."""

import pytest

from ivfmc_ros.nodes.framework.environment import missing

RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'


def test_cell_is_seen_on_its_own_computer_by_default():
    assert missing({})[RANGE] == 'LOCALHOST'
    assert missing({RANGE: ''})[RANGE] == 'LOCALHOST'


@pytest.mark.parametrize('given', [{RANGE: 'SUBNET'}, {'ROS_LOCALHOST_ONLY': '0'}])
def test_range_that_is_given_is_kept(given):
    assert RANGE not in missing(given)


def test_profiles_that_are_given_are_kept():
    assert 'FASTRTPS_DEFAULT_PROFILES_FILE' in missing({})
    given = {'FASTDDS_DEFAULT_PROFILES_FILE': 'other.xml'}
    assert 'FASTRTPS_DEFAULT_PROFILES_FILE' not in missing(given)
