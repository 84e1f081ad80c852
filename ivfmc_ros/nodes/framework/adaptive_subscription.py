# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A subscription with the QoS that the publishers of its topic offer.

A reliable listener hears nothing of a best effort publisher, a latched one nothing of a volatile
publisher, and neither is told. So the graph is asked, again and again, because publishers come
and go.
"""

from collections.abc import Callable
from typing import Any

from rclpy.qos import DurabilityPolicy
from rclpy.qos import QoSProfile
from rclpy.qos import ReliabilityPolicy

from ivfmc_ros.nodes.framework import qos
from ivfmc_ros.nodes.framework.base import CellNode

LOOK_S = 0.25


class AdaptiveSubscription:
    """Subscribes ``topic``, and again where what its publishers offer changes."""

    def __init__(
        self,
        node: CellNode,
        kind: type,
        topic: str,
        callback: Callable[[Any], object],
        depth: int | None = None,
        raw: bool = False,
    ) -> None:
        """
        Subscribe, reliable until publishers are known.

        depth : messages that may wait; None for that of the topic's name
        raw : ``callback`` gets the bytes of the message
        """
        self._node = node
        self._kind = kind
        self._topic = topic
        self._raw = raw
        self._depth = depth or int(qos.of_topic(topic).depth)
        self._callback = node.border(callback, topic)
        self._offer = (ReliabilityPolicy.RELIABLE, DurabilityPolicy.VOLATILE)
        self._subscription = self._subscribe()
        self._timer = node.steady_timer(LOOK_S, self._look)

    @property
    def topic(self) -> str:
        """The full name of the topic."""
        return str(self._node.resolve_topic_name(self._topic))

    @property
    def publishers(self) -> int:
        """How many there are."""
        return int(self._node.count_publishers(self.topic))

    def drain(self) -> None:
        """
        Take all messages that wait.

        An executor takes one message of each topic in a round; whoever works for long in a round
        would be late for the others, and lose them when they are more than ``depth``.
        """
        handle = self._subscription.handle
        for _ in range(self._depth):
            with handle:
                taken = handle.take_message(self._kind, self._raw)
            if taken is None:
                return
            self._callback(taken[0])

    def destroy(self) -> None:
        """Listen no longer."""
        self._node.destroy_timer(self._timer)
        self._node.destroy_subscription(self._subscription)

    def _look(self) -> None:
        found = self._node.get_publishers_info_by_topic(self.topic)
        offers = [info.qos_profile for info in found]
        if not offers:
            return
        # what the least generous of them offers is heard of all of them
        reliable = all(o.reliability == ReliabilityPolicy.RELIABLE for o in offers)
        lasting = all(o.durability == DurabilityPolicy.TRANSIENT_LOCAL for o in offers)
        offer = (
            ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
            DurabilityPolicy.TRANSIENT_LOCAL if lasting else DurabilityPolicy.VOLATILE,
        )
        if offer != self._offer:
            self._offer = offer
            self._node.destroy_subscription(self._subscription)
            self._subscription = self._subscribe()

    def _subscribe(self) -> Any:
        reliability, durability = self._offer
        profile = QoSProfile(depth=self._depth, reliability=reliability, durability=durability)
        return self._node.create_subscription(
            self._kind,
            self._topic,
            self._callback,
            profile,
            raw=self._raw,
            event_callbacks=qos.NO_SUBSCRIPTION_EVENTS,
        )
