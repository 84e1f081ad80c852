# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Heartbeats are fetched, and wake no executor."""

import time

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from std_msgs.msg import Header
from support.graph_rig import DOMAIN
from support.graph_rig import node_environment

from ivfmc_ros.nodes.framework import qos
from ivfmc_ros.nodes.framework.executor import NodeExecutor
from ivfmc_ros.nodes.framework.heartbeats import Heartbeats

NAMES = ('camera', 'mesher')


@pytest.fixture
def context(monkeypatch):
    for name, value in node_environment().items():
        monkeypatch.setenv(name, value)
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=DOMAIN)
    yield context
    rclpy.try_shutdown(context=context)


@pytest.fixture(params=[NodeExecutor, SingleThreadedExecutor])
def executor(request, context):
    executor = request.param(context=context)
    yield executor
    executor.shutdown()


@pytest.fixture
def node(context, executor):
    node = rclpy.create_node('listener', context=context)
    executor.add_node(node)
    yield node
    executor.shutdown()
    node.destroy_node()


def until(condition):
    deadline = time.monotonic() + 20.0
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def publishers(node):
    found = {
        name: node.create_publisher(Header, f'{name}/heartbeat', qos.reliable(10))
        for name in NAMES
    }
    until(lambda: all(one.get_subscription_count() for one in found.values()))
    return found


def test_each_node_is_named_once_a_fetch_and_only_when_it_gave_a_heartbeat(node):
    heard = []
    heartbeats = Heartbeats(node, NAMES, heard.append)
    beating = publishers(node)
    for _ in range(3):
        beating['camera'].publish(Header())
    until(lambda: heartbeats.fetch() or heard)
    time.sleep(0.1)
    heartbeats.fetch()
    assert set(heard) == {'camera'}
    assert len(heard) <= 3
    heard.clear()
    heartbeats.fetch()
    assert heard == []
    beating['mesher'].publish(Header())
    until(lambda: heartbeats.fetch() or heard == ['mesher'])


def test_heartbeat_wakes_no_executor(node, executor):
    heard = []
    heartbeats = Heartbeats(node, NAMES, heard.append)
    beating = publishers(node)
    # what the creation of the entities has triggered
    for _ in range(5):
        executor.spin_once(timeout_sec=0.05)
    beating['camera'].publish(Header())
    begin = time.monotonic()
    executor.spin_once(timeout_sec=0.4)
    assert time.monotonic() - begin > 0.35
    assert heard == []
    heartbeats.fetch()
    assert heard == ['camera']


def test_closed_ones_leave_the_graph(node):
    heartbeats = Heartbeats(node, NAMES, lambda name: None)
    beating = publishers(node)
    heartbeats.close()
    until(lambda: not any(one.get_subscription_count() for one in beating.values()))
    heartbeats.fetch()
