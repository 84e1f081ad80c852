# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The life of a node: its heartbeat, and the detection of a second node of the same name.

Both would answer every request. Each hears the heartbeat of the other, and the one that has run
for the shorter time ends. ROS names alone do not tell: a node that was killed stays in the graph.
"""

from collections.abc import Callable
import secrets
import time
from typing import Any

from rclpy.node import Node
from rclpy.task import Future
from std_msgs.msg import Header

from ivfmc_ros.nodes.framework import qos

# Period of heartbeats, seconds: the contract is 5 Hz or more, and each one wakes two nodes.
HEARTBEAT_S = 0.15
# Age in seconds from which a node serves requests: discovery takes less on an idle computer.
_SETTLE_S = 1.0
# ... where the graph has another publisher of its heartbeat, which may be that of a dead node.
_DOUBTFUL_S = 3.0
# Seconds between two looks for a second publisher of the heartbeat.
_LOOK_S = 1.0
# Ages that differ by less are equal, seconds: messages take that long.
_SAME_AGE_S = 0.5


def life_of(message: Header) -> str:
    """Return which life of a node a heartbeat comes from: a restarted node has another one."""
    name = str(message.frame_id)
    parts = name.split('/')
    return parts[1] if len(parts) == 3 else name


class Life:
    """
    Publishes the heartbeat of a node, and listens for one of a second node of its name.

    id : of this process; the frame_id of a heartbeat is 'name/id/age in seconds'
    refusal : why this node has to end, '' while it need not
    """

    def __init__(self, node: Node, on_settled: Callable[[], object]) -> None:
        """``on_settled``: called once, when this node has found no second one."""
        self.id = secrets.token_hex(4)
        self.refusal = ''
        self._node = node
        self._on_settled = on_settled
        self._begin_s = time.monotonic()
        self._settled = False
        self._looked_s = 0.0
        self._waiting: list[Future] = []
        self._publisher = node.create_publisher(
            Header, '~/heartbeat', qos.reliable(10), event_callbacks=qos.NO_PUBLISHER_EVENTS
        )
        self._subscription: Any = None
        self._listen()

    @property
    def age_s(self) -> float:
        """Seconds since the start of the node, on a steady clock."""
        return time.monotonic() - self._begin_s

    async def settled(self) -> None:
        """Return when it is known that this node is the only one of its name."""
        if not self._settled:
            waiting = Future(executor=self._node.executor)
            self._waiting.append(waiting)
            await waiting

    def beat(self) -> None:
        """Publish a heartbeat; to be called every ``HEARTBEAT_S``."""
        header = Header(frame_id=f'{self._node.get_name()}/{self.id}/{self.age_s:.1f}')
        header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(header)
        if not self._settled and not self.refusal and self._is_alone():
            self._settled = True
            self._on_settled()
            for waiting in self._waiting:
                waiting.set_result(None)
        if self._settled and self.age_s - self._looked_s > _LOOK_S:
            self._looked_s = self.age_s
            self._listen_for_another()

    def _listen_for_another(self) -> None:
        """
        Receive heartbeats only while the graph has a second publisher of them.

        Otherwise every own heartbeat would wake this node once more.
        """
        if self._node.count_publishers(self._publisher.topic_name) > 1:
            self._listen()
        elif self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
            self._subscription = None

    def _listen(self) -> None:
        if self._subscription is None:
            self._subscription = self._node.create_subscription(
                Header,
                '~/heartbeat',
                self._receive,
                qos.reliable(10),
                event_callbacks=qos.NO_SUBSCRIPTION_EVENTS,
            )

    def _is_alone(self) -> bool:
        if self.age_s < _SETTLE_S:
            return False
        others = self._node.count_publishers(self._publisher.topic_name) > 1
        return not others or self.age_s >= _DOUBTFUL_S

    def _receive(self, message: Header) -> None:
        _, _, rest = message.frame_id.partition('/')
        other, _, age = rest.partition('/')
        if not age or other == self.id:
            return
        older_s = float(age) - self.age_s
        if older_s > _SAME_AGE_S or (older_s > -_SAME_AGE_S and other < self.id):
            self.refusal = (
                f'a node {self._node.get_fully_qualified_name()} runs already, for {age} s; end '
                'it first, or choose another namespace or ROS_DOMAIN_ID'
            )
