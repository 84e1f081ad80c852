# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Recorders that are killed in mid-scan; ``make bench NAME=storage`` does it 50 times."""

import random

import pytest
from support.killed_recorder import encoded_profiles
from support.killed_recorder import kill_recorder


@pytest.fixture(scope='module')
def messages():
    return encoded_profiles(200)


@pytest.mark.parametrize('seed', range(3))
def test_no_acknowledged_profile_is_lost_by_a_kill(tmp_path, messages, seed):
    kill = kill_recorder(tmp_path / 's1', messages, random.Random(seed).uniform(0.3, 1.2))
    assert (kill.lost, kill.wrong, kill.fault) == (0, 0, ''), kill
    assert 0 < kill.acknowledged <= kill.kept
