# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0

import pytest
from support.clock import Clock

from ivfmc_ros.nodes.framework.health import Health
from ivfmc_ros.nodes.framework.health import Level
from ivfmc_ros.nodes.framework.health import SETTLE_S
from ivfmc_ros.nodes.framework.health import WAITING


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def log():
    return []


@pytest.fixture
def health(log, clock):
    return Health(lambda level, line: log.append((level, line)), clock)


def settle(health, clock):
    clock.now_s += SETTLE_S
    health.log_ended()


def test_condition_is_logged_when_it_begins_and_when_it_has_ended(health, log, clock):
    health.set('low', 'disk', Level.WARN, '3 GB left', 'enough space again')
    health.set('low', 'disk', Level.WARN, '3 GB left', 'enough space again')
    assert log == [(Level.WARN, 'disk: 3 GB left')]
    health.clear('low', 'disk')
    health.clear('low', 'disk')
    settle(health, clock)
    settle(health, clock)
    assert log[1:] == [(Level.OK, 'disk: enough space again')]


def test_message_that_changes_is_the_same_condition(health, log):
    for gigabytes in range(200):
        health.set('low', 'disk', Level.WARN, f'{gigabytes} GB left')
    assert log == [(Level.WARN, 'disk: 0 GB left')]
    # diagnostics have the newest one
    assert health.messages == {'disk: low': '199 GB left'}
    assert health.worst() == (Level.WARN, 'disk: 199 GB left')


def test_condition_that_alternates_with_good_messages_is_logged_once(health, log, clock):
    for number in range(200):
        health.fault('profile', 'BAD_MESSAGE', f'{number} bytes are missing')
        clock.now_s += 0.01
        health.log_ended()
        health.clear_fault('profile')
        clock.now_s += 0.01
        health.log_ended()
    assert log == [(Level.ERROR, 'profile: 0 bytes are missing')]
    settle(health, clock)
    assert log[1:] == [(Level.OK, 'profile: recovered')]
    health.fault('profile', 'BAD_MESSAGE', 'is big-endian')
    assert log[2:] == [(Level.ERROR, 'profile: is big-endian')]


def test_conditions_of_other_kinds_and_objects_are_conditions_of_their_own(health, log):
    health.set(WAITING, 'view', Level.OK, 'waiting for view')
    health.set(WAITING, 'profile', Level.OK, 'waiting for profile')
    health.fault('profile', 'BAD_MESSAGE', 'is big-endian')
    assert [line for _, line in log] == [
        'view: waiting for view',
        'profile: waiting for profile',
        'profile: is big-endian',
    ]
    assert health.worst() == (Level.ERROR, 'profile: is big-endian')
    health.clear_fault('profile')
    assert health.worst() == (Level.OK, 'view: waiting for view; profile: waiting for profile')


def test_fault_of_another_kind_replaces_the_one_before(health, log, clock):
    health.fault('controller', 'LOST', 'no answer')
    health.fault('controller', 'ALARM', 'position lost')
    assert health.messages == {'controller: ALARM': 'position lost'}
    settle(health, clock)
    assert [level for level, _ in log] == [Level.ERROR, Level.ERROR, Level.OK]


def test_waiting_that_lasts_becomes_a_warning_once(health, log):
    for level in (Level.OK, Level.OK, Level.WARN, Level.WARN):
        health.set(WAITING, 'view', level, 'waiting for view')
    assert [level for level, _ in log] == [Level.OK, Level.WARN]
