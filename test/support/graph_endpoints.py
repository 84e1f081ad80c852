# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the nodes of a cell publish, subscribe to, serve and call, as the graph shows it."""

from collections import defaultdict
from collections.abc import Callable
from typing import Any

from support.graph_rig import NAMESPACE

# Kind of an endpoint: direction and object of a rule of an SROS2 policy.
PUBLISH, SUBSCRIBE = ('publish', 'topic'), ('subscribe', 'topic')
REPLY, REQUEST = ('reply', 'service'), ('request', 'service')

Endpoint = tuple[tuple[str, str], str]


def endpoints(node: Any) -> dict[str, set[Endpoint]]:
    """
    Return the endpoints of each node in the namespace of the cell, with full names.

    node : of rclpy, which asks the graph
    """
    found: dict[str, set[Endpoint]] = defaultdict(set)
    asked: dict[tuple[str, str], Callable[..., Any]] = {
        PUBLISH: node.get_publisher_names_and_types_by_node,
        SUBSCRIBE: node.get_subscriber_names_and_types_by_node,
        REPLY: node.get_service_names_and_types_by_node,
        REQUEST: node.get_client_names_and_types_by_node,
    }
    for name, namespace in node.get_node_names_and_namespaces():
        if namespace != NAMESPACE or name == node.get_name():
            continue
        for kind, ask in asked.items():
            found[name] |= {(kind, full) for full, _ in ask(name, namespace)}
    return found
