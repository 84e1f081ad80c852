# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Work in a thread that outlives its node."""

import threading

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor

from ivfmc_ros.nodes.framework.thread_work import start_thread


@pytest.fixture
def executor():
    context = rclpy.Context()
    rclpy.init(context=context)
    yield SingleThreadedExecutor(context=context)
    rclpy.shutdown(context=context)


@pytest.mark.parametrize('fails', [False, True])
def test_work_that_ends_after_its_node_prints_nothing(executor, fails, monkeypatch, capfd):
    uncaught, node_has_ended = [], threading.Event()
    monkeypatch.setattr(threading, 'excepthook', uncaught.append)

    def work():
        node_has_ended.wait()
        if fails:
            raise ValueError('the work failed')

    future = start_thread(executor, 'plain work', work)
    executor.shutdown()
    node_has_ended.set()
    for thread in threading.enumerate():
        if thread.name == 'plain work':
            thread.join(10.0)
    del future
    assert not uncaught
    assert capfd.readouterr().err == ''
