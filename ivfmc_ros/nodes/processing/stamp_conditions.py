# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Conditions of a node by its inputs: clocks that differ, stamps and positions that jump."""

from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.nodes.framework.health import Level
from ivfmc_ros.storage.matching.clock_offset import clock_text
from ivfmc_ros.storage.matching.clock_offset import clocks_differ

# Seconds after a jump of the stamps until it is no condition any more.
_JUMP_CONDITION_S = 5.0
# Kinds of conditions.
_JUMP = 'stamps jumped back'
_CLOCKS = 'clocks differ'
_POSITIONS = 'positions contradict'
# Seconds after the last contradictory positions until they are no condition any more.
_POSITIONS_CONDITION_S = 5.0


class StampConditions:
    """
    Sets and clears the conditions.

    clock_offset_s : seconds by which the stamps of the images are ahead of those of the table
    table_fault : why the positions of the table cannot be right, and who publishes them; '' if
        they can
    """

    def __init__(self, node: CellNode) -> None:
        self.clock_offset_s = 0.0
        self.table_fault = ''
        self._node = node
        self._fault_s = -_POSITIONS_CONDITION_S
        # when the stamps of a topic last jumped back, steady clock
        self._jumps_s: dict[str, float] = {}

    def report_jump(self, topic: str) -> None:
        """Note that the stamps of a topic jumped back."""
        self._jumps_s[topic] = self._node.steady_s()
        text = 'stamps jumped back; the states received before are discarded'
        self._node.health.set(_JUMP, topic, Level.WARN, text, 'stamps increase again')

    def judge_table(self, fault: str, topic: str) -> None:
        """
        Set or clear the condition that the table's positions cannot be right.

        fault : of the newest positions, as ``FrameMatcher`` has it
        topic : of the joint states; its publishers are named
        """
        now_s = self._node.steady_s()
        if fault:
            self._fault_s = now_s
            infos = self._node.get_publishers_info_by_topic(topic)
            names = sorted(f'{i.node_namespace.rstrip("/")}/{i.node_name}' for i in infos)
            self.table_fault = (
                f'{topic}: {fault}; published by {" and ".join(names) or "no known node"}; '
                'only one node may publish the joint of the table'
            )
            self._node.health.set(_POSITIONS, topic, Level.ERROR, self.table_fault)
        elif now_s - self._fault_s >= _POSITIONS_CONDITION_S:
            self.table_fault = ''
            self._node.health.clear(_POSITIONS, topic)

    def update(self, images: str, joints: str) -> None:
        """
        Compare the clocks, and end the conditions that are over.

        images, joints : names of the topics
        """
        for topic, jumped_s in list(self._jumps_s.items()):
            if self._node.steady_s() - jumped_s > _JUMP_CONDITION_S:
                del self._jumps_s[topic]
                self._node.health.clear(_JUMP, topic)
        offset, health = self.clock_offset_s, self._node.health
        if not clocks_differ(offset):
            health.clear(_CLOCKS, images)
            return
        health.set(_CLOCKS, images, Level.WARN, clock_text(offset), f'clock agrees with {joints}')
