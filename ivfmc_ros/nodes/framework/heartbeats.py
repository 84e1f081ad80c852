# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The heartbeats of other nodes, fetched together where their age is judged.

A cell has fifty of them a second: each would wake the process that listens.
"""

from collections.abc import Callable
from collections.abc import Iterable
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from std_msgs.msg import Header

from ivfmc_ros.nodes.framework import qos


class FetchedGroup(CallbackGroup):
    """A group of subscriptions whose messages their owner fetches: no executor waits for them."""

    def can_execute(self, entity: Any) -> bool:
        """Return False."""
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """Return False."""
        return False

    def ending_execution(self, entity: Any) -> None:
        """Do nothing: no execution begins."""


class Heartbeats:
    """Subscriptions to the heartbeats of nodes, whose owner fetches several times a second."""

    def __init__(self, node: Node, names: Iterable[str], on_beat: Callable[[str], object]) -> None:
        """
        Subscribe.

        on_beat : called with the name of each node of which a heartbeat came since the last fetch
        """
        group = FetchedGroup()
        self._node, self._on_beat = node, on_beat
        # best effort: the next one replaces one that is lost, and none has to be acknowledged
        self._subscriptions = {
            name: node.create_subscription(
                Header,
                f'{name}/heartbeat',
                _not_called,
                qos.best_effort(1),
                callback_group=group,
                event_callbacks=qos.NO_SUBSCRIPTION_EVENTS,
            )
            for name in names
        }

    def close(self) -> None:
        """End the subscriptions."""
        for subscription in self._subscriptions.values():
            self._node.destroy_subscription(subscription)
        self._subscriptions.clear()

    def fetch(self) -> None:
        """Call ``on_beat`` for the nodes that gave a heartbeat."""
        for name, subscription in self._subscriptions.items():
            handle = subscription.handle
            with handle:
                # serialized: a Header would cost more than all the rest
                taken = handle.take_message(Header, True)
            if taken is not None:
                self._on_beat(name)


def _not_called(_: Header) -> None:
    """Stand for the callback of a subscription that no executor waits for."""
