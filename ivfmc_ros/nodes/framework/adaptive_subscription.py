# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A subscription with the QoS that the publishers of its topic offer.

A reliable subscription receives nothing from a best-effort publisher, nor a transient-local one
from a volatile publisher. The offered QoS is therefore read from the ROS graph periodically, and
the subscription is created again when it has changed.
"""

from collections.abc import Callable
from typing import Any

from rclpy.qos import DurabilityPolicy
from rclpy.qos import QoSProfile
from rclpy.qos import ReliabilityPolicy

from ivfmc_ros.nodes.framework import qos
from ivfmc_ros.nodes.framework.base import CellNode

# Seconds between two looks at the graph: new publishers are received after half of it on average.
POLL_S = 0.25


class AdaptiveSubscription:
    """Subscribes to ``topic``, and again when the QoS that its publishers offer has changed."""

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
        Subscribe, with the QoS of this package's own publishers until others are known.

        depth : length of the queue; None for the one of the topic in ``qos``
        raw : ``callback`` takes the serialized message
        """
        self._node = node
        self._kind = kind
        self._topic = topic
        self._raw = raw
        self._depth = depth or int(qos.of_topic(topic).depth)
        self._callback = node.guarded(callback, topic)
        # created twice, a transient-local subscription would receive the latched messages twice
        own = qos.of_topic(topic)
        self._offered = (own.reliability, own.durability)
        self._subscription = self._subscribe()
        self._timer = node.steady_timer(POLL_S, self._adapt)

    @property
    def topic(self) -> str:
        """The fully qualified name of the topic."""
        return str(self._node.resolve_topic_name(self._topic))

    @property
    def publishers(self) -> int:
        """The number of publishers on the topic."""
        return int(self._node.count_publishers(self.topic))

    def drain(self) -> None:
        """
        Process all messages in the queue.

        An executor takes one message of each topic in a round. A callback that works for long in
        each round would be late for the others, and lose them when they are more than ``depth``.
        """
        handle = self._subscription.handle
        for _ in range(self._depth):
            with handle:
                taken = handle.take_message(self._kind, self._raw)
            if taken is None:
                return
            self._callback(taken[0])

    def destroy(self) -> None:
        """End the subscription."""
        self._node.destroy_timer(self._timer)
        self._node.destroy_subscription(self._subscription)

    def _adapt(self) -> None:
        found = self._node.get_publishers_info_by_topic(self.topic)
        profiles = [info.qos_profile for info in found]
        if not profiles:
            return
        # the weakest offer is compatible with all publishers
        reliable = all(p.reliability == ReliabilityPolicy.RELIABLE for p in profiles)
        latched = all(p.durability == DurabilityPolicy.TRANSIENT_LOCAL for p in profiles)
        offered = (
            ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
            DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        )
        if offered != self._offered:
            self._offered = offered
            self._node.destroy_subscription(self._subscription)
            self._subscription = self._subscribe()

    def _subscribe(self) -> Any:
        reliability, durability = self._offered
        profile = QoSProfile(depth=self._depth, reliability=reliability, durability=durability)
        return self._node.create_subscription(
            self._kind,
            self._topic,
            self._callback,
            profile,
            raw=self._raw,
            event_callbacks=qos.NO_SUBSCRIPTION_EVENTS,
        )
