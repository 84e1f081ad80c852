# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import asyncio

import pytest

from ivfmc_ros.errors import NotReadyError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.errors import StateError
from ivfmc_ros.nodes.viewing.cell_actions import CellActions


class Publisher:
    def __init__(self):
        self.messages = []

    def publish(self, message):
        self.messages.append(message)


class FakeNode:
    def __init__(self):
        self.trajectory = Publisher()

    def get(self, name):
        return 'turntable_joint'


@pytest.fixture
def actions():
    # without the services of a graph
    actions = CellActions.__new__(CellActions)
    actions._node = FakeNode()
    actions._trajectory = actions._node.trajectory
    actions.position, actions.idle = 1.0, True
    return actions


def test_table_is_turned_by_hand_in_an_idle_cell(actions):
    asyncio.run(actions._jog(-0.25))
    [message] = actions._node.trajectory.messages
    assert message.points[0].positions[0] == 0.75
    assert message.points[0].time_from_start.nanosec == 500_000_000


@pytest.mark.parametrize('call', ['_jog', '_light'])
def test_nothing_is_moved_or_lit_by_hand_while_a_scan_runs(actions, call):
    actions.idle = False
    arguments = (0.25,) if call == '_jog' else ('left', True)
    with pytest.raises(StateError, match='a scan runs'):
        asyncio.run(getattr(actions, call)(*arguments))
    assert actions._node.trajectory.messages == []


def test_table_of_unknown_position_is_not_turned(actions):
    actions.position = None
    with pytest.raises(NotReadyError):
        asyncio.run(actions._jog(0.25))


def test_other_services_are_not_called(actions):
    with pytest.raises(ParameterError, match='request'):
        actions.control('shutdown')
