# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the table stands, by the joint states that the orchestrator received."""

from collections import deque
from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')
from sensor_msgs.msg import JointState

from ivfmc_ros.nodes.scanning import cell_link

TARGET = 0.5
MOVE_S, PERIOD_S = 1.0, 0.01


class Link(cell_link.CellLink):
    """A link that receives joint states and nothing else."""

    def __init__(self):
        self.joint = 'table'
        self.reports = deque(maxlen=cell_link._JOINT_REPORTS)
        self.watch = SimpleNamespace(heartbeat=lambda name: None)
        self._reports_since_command, self._moved_ns = 0, 0
        self._trajectory = SimpleNamespace(publish=lambda message: None)

    def _check_stamp(self, topic, stamp_ns):
        pass

    def run(self, seconds, lost=(0.0, 0.0), with_velocity=True):
        """Joint states of a move and of the standstill after it; some seconds of them are lost."""
        for number in range(round(seconds / PERIOD_S)):
            second = number * PERIOD_S
            if lost[0] <= second < lost[1]:
                continue
            moves = second < MOVE_S
            message = JointState(name=['table'])
            message.header.stamp.sec = 100 + int(second)
            message.header.stamp.nanosec = round(second % 1.0 * 1e9)
            message.position = [TARGET * min(second / MOVE_S, 1.0)]
            if with_velocity:
                message.velocity = [TARGET / MOVE_S if moves else 0.0]
            self._receive_joints(message)


@pytest.mark.parametrize(
    ('seconds', 'lost'),
    # one after the other; many at once, of which the last are kept; the first ones lost, and the
    # last ones of the move
    [(1.2, (0.0, 0.0)), (4.0, (0.0, 0.0)), (2.5, (1.0, 2.2)), (2.5, (0.92, 2.2))],
)
@pytest.mark.parametrize('with_velocity', [True, False])
def test_profile_right_after_the_move_is_of_this_standstill(seconds, lost, with_velocity):
    link = Link()
    link.command(TARGET, MOVE_S)
    link.run(seconds, lost, with_velocity)
    assert link.stands_at(TARGET, 1e-3)
    assert link.standstill.shows(TARGET, round((100.0 + MOVE_S + 0.05) * 1e9))
    assert not link.standstill.shows(0.9 * TARGET, round((100.0 + 0.9 * MOVE_S) * 1e9))


def test_profile_before_the_command_is_of_another_standstill():
    link = Link()
    link.run(2.0)
    link.command(TARGET, MOVE_S)
    assert not link.standstill.shows(TARGET, round(101.5 * 1e9))
