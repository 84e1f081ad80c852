# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from diagnostic_msgs.msg import DiagnosticStatus
from diagnostic_msgs.msg import KeyValue
import pytest

from ivfmc_ros.nodes.viewing.node_health import NodeHealth


class Clock:
    now = 10.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def health(clock):
    return NodeHealth('/ivfmc', clock)


def status(name, level=b'\x00', message='running', **values):
    pairs = [KeyValue(key=key, value=value) for key, value in values.items()]
    return DiagnosticStatus(name=name, level=level, message=message, values=pairs)


def test_nodes_of_the_cell_are_listed_by_name(health):
    health.add(status('ivfmc/mesher'))
    health.add(status('ivfmc/camera', b'\x02', 'no device'))
    health.add(status('other/camera', b'\x02', 'of another cell'))
    assert health.rows() == [('camera', 'error', 'no device'), ('mesher', 'ok', 'running')]


def test_node_that_is_silent_is_lost(health, clock):
    health.add(status('ivfmc/camera'))
    clock.now += 3.5
    assert health.rows() == [('camera', 'lost', 'silent for 4 s')]
    health.add(status('ivfmc/camera'))
    assert health.rows()[0][1] == 'ok'


def test_node_that_up_saw_end_is_lost_at_once(health):
    health.add(status('ivfmc/camera'))
    health.add(status('ivfmc/up', b'\x02', 'camera was killed by signal 9', ended='camera'))
    assert ('camera', 'lost', 'camera was killed by signal 9') in health.rows()


def test_second_node_of_a_name_is_not_listed(health):
    health.add(status('ivfmc/mesher (second node of this name)', b'\x02', 'refused'))
    assert health.rows() == []
