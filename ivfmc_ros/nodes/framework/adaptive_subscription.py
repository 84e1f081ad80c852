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
from typing import ClassVar
from weakref import WeakKeyDictionary

from rclpy.qos import DurabilityPolicy
from rclpy.qos import QoSProfile
from rclpy.qos import ReliabilityPolicy

from ivfmc_ros.nodes.framework import qos
from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.nodes.framework.timers import set_period

# Seconds between two looks at the graph, for the first seconds of a subscription and afterwards.
# New publishers are received after half of it on average.
POLL_S, _SETTLED_POLL_S = 0.25, 1.0
_SETTLING_S = 5.0


class _GraphPoll:
    """One timer by which all adaptive subscriptions of a node look at the graph."""

    _of_node: ClassVar[WeakKeyDictionary[CellNode, '_GraphPoll']] = WeakKeyDictionary()

    def __init__(self, node: CellNode) -> None:
        self._node = node
        self._callbacks: list[Callable[[], None]] = []
        self._settled_s = 0.0
        self._timer = node.steady_timer(POLL_S, self._poll)
        self.hurry()

    @classmethod
    def of(cls, node: CellNode) -> '_GraphPoll':
        """Return the one of a node."""
        if node not in cls._of_node:
            cls._of_node[node] = cls(node)
        return cls._of_node[node]

    def add(self, callback: Callable[[], None]) -> None:
        self._callbacks.append(callback)
        self.hurry()

    def remove(self, callback: Callable[[], None]) -> None:
        self._callbacks.remove(callback)

    def hurry(self) -> None:
        """Look more often for some seconds: a subscription is new."""
        self._settled_s = self._node.steady_s() + _SETTLING_S
        set_period(self._timer, POLL_S)

    def _poll(self) -> None:
        for callback in list(self._callbacks):
            callback()
        if self._node.steady_s() > self._settled_s:
            set_period(self._timer, _SETTLED_POLL_S)


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
        self._poll = _GraphPoll.of(node)
        self._poll.add(self._adapt)

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
        if self._subscription is None:
            return
        handle = self._subscription.handle
        for _ in range(self._depth):
            with handle:
                taken = handle.take_message(self._kind, self._raw)
            if taken is None:
                return
            self._callback(taken[0])

    @property
    def is_paused(self) -> bool:
        """Whether no messages are received, by ``pause``."""
        return self._subscription is None

    def pause(self) -> None:
        """Receive no messages until ``resume``: they cost their transport and wake the node."""
        if self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
            self._subscription = None

    def resume(self) -> None:
        """Receive messages again, within some 0.1 s."""
        if self._subscription is None:
            # not followed during the pause
            self._offered = self._find_offered()
            self._subscription = self._subscribe()
            self._poll.hurry()

    def destroy(self) -> None:
        """End the subscription."""
        self._poll.remove(self._adapt)
        self.pause()

    def _adapt(self) -> None:
        if self._subscription is None:
            return
        offered = self._find_offered()
        if offered != self._offered:
            self._offered = offered
            self._node.destroy_subscription(self._subscription)
            self._subscription = self._subscribe()

    def _find_offered(self) -> tuple[ReliabilityPolicy, DurabilityPolicy]:
        """Return what all publishers offer; what they did where there is none."""
        found = self._node.get_publishers_info_by_topic(self.topic)
        profiles = [info.qos_profile for info in found]
        if not profiles:
            return self._offered
        # the weakest offer is compatible with all publishers
        reliable = all(p.reliability == ReliabilityPolicy.RELIABLE for p in profiles)
        latched = all(p.durability == DurabilityPolicy.TRANSIENT_LOCAL for p in profiles)
        return (
            ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
            DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        )

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
