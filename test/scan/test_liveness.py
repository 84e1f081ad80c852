# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import math

import pytest

from ivfmc_ros.errors import HelperError
from ivfmc_ros.errors import ParameterError
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
