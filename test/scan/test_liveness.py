# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import math

import pytest

from ivfmc_ros.errors import HelperError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.scan.liveness import AttentiveClock
from ivfmc_ros.scan.liveness import LivenessMonitor


class Clock:
    now = 100.0

    def __call__(self):
        return self.now


def test_node_with_a_recent_heartbeat_is_alive():
    clock = Clock()
    monitor = LivenessMonitor(1.0, clock)
    monitor.heartbeat('camera')
    clock.now += 0.9
    monitor.require_alive(['camera'])
    assert monitor.age_s('camera') == pytest.approx(0.9)


def test_node_without_recent_heartbeat_is_named_with_the_age():
    clock = Clock()
    monitor = LivenessMonitor(1.0, clock)
    monitor.heartbeat('camera')
    clock.now += 1.5
    with pytest.raises(HelperError, match=r'camera \(last 1\.5 s ago\)') as caught:
        monitor.require_alive(['camera'])
    assert caught.value.code == 'CAMERA_LOST'


def test_node_without_any_heartbeat_is_lost():
    with pytest.raises(HelperError, match=r'mesher \(none received\)'):
        LivenessMonitor(1.0).require_alive(['mesher'])


@pytest.mark.parametrize('timeout_s', [0.0, -1.0, math.nan])
def test_timeout_that_is_not_positive_is_refused(timeout_s):
    with pytest.raises(ParameterError, match='limit'):
        LivenessMonitor(timeout_s)


def test_time_in_which_the_receiver_was_late_counts_towards_no_time_out():
    clock = Clock()
    own = AttentiveClock(0.1, clock)
    monitor = LivenessMonitor(1.0, own)
    monitor.heartbeat('triangulator')
    for _ in range(3):
        # stopped for seconds; the heartbeats are still in the queue
        clock.now += 5.0
        monitor.require_alive(['triangulator'])
        own.tick()
        monitor.require_alive(['triangulator'])


def test_silent_node_is_lost_as_soon_when_the_receiver_is_on_time():
    clock = Clock()
    own = AttentiveClock(0.1, clock)
    monitor = LivenessMonitor(1.0, own)
    monitor.heartbeat('triangulator')
    for _ in range(10):
        clock.now += 0.1
        own.tick()
        monitor.require_alive(['triangulator'])
    clock.now += 0.1
    own.tick()
    with pytest.raises(HelperError, match='triangulator'):
        monitor.require_alive(['triangulator'])


def test_silent_node_is_lost_although_the_receiver_is_loaded():
    clock = Clock()
    own = AttentiveClock(0.1, clock)
    monitor = LivenessMonitor(1.0, own)
    monitor.heartbeat('triangulator')
    for _ in range(8):
        clock.now += 0.3
        own.tick()
    with pytest.raises(HelperError, match='triangulator'):
        monitor.require_alive(['triangulator'])


def test_node_that_was_seen_to_end_is_lost_at_once_until_it_is_heard_again():
    clock = Clock()
    watch = LivenessMonitor(2.0, clock)
    watch.heartbeat('mesher')
    watch.end('mesher', 'mesher was killed by signal 9; it is started again in 0.5 s')
    with pytest.raises(HelperError, match='killed by signal 9') as caught:
        watch.require_alive(['mesher'])
    assert caught.value.code == 'MESHER_LOST'
    watch.heartbeat('mesher')
    watch.require_alive(['mesher'])
