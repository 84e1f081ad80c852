# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import pytest

from ivfmc_ros.cli.support.restarts import MOST
from ivfmc_ros.cli.support.restarts import Restarts
from ivfmc_ros.errors import HelperError


@pytest.fixture
def clock():
    return [100.0]


@pytest.fixture
def restarts(clock):
    return Restarts(lambda: clock[0])


def end(restarts, clock, name='camera'):
    """Let a process end, wait for its restart, and return the seconds until then."""
    delay, _ = restarts.add(name)
    clock[0] += delay
    assert restarts.due() == [name]
    return delay


def test_each_restart_comes_later(restarts, clock):
    delays = [end(restarts, clock) for _ in range(MOST)]
    assert delays == [0.5, 1.0, 2.0, 4.0, 8.0]


def test_process_is_pending_until_it_is_due(restarts, clock):
    assert restarts.add('camera') == (0.5, 1)
    assert restarts.pending == {'camera'}
    assert restarts.due() == []
    clock[0] += 0.5
    assert restarts.due() == ['camera']
    assert restarts.pending == set()


def test_process_that_ends_too_often_is_given_up(restarts, clock):
    for _ in range(MOST):
        end(restarts, clock)
    with pytest.raises(HelperError, match='camera ended 6 times within 10 minutes'):
        restarts.add('camera')


def test_restarts_of_long_ago_and_of_others_do_not_count(restarts, clock):
    for _ in range(MOST):
        end(restarts, clock)
    assert end(restarts, clock, 'mesher') == 0.5
    clock[0] += 600.0
    assert end(restarts, clock) == 0.5
