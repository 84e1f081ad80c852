# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Work in a thread, whose result a callback of the node awaits."""

from collections.abc import Callable
from functools import partial
import threading
from typing import Any

from rclpy.executors import Executor
from rclpy.task import Future


def start_thread(executor: Executor | None, name: str, function: Callable[[], Any]) -> Future:
    """
    Run ``function`` in a daemon thread and return a future of its result.

    executor : of the node that awaits the future; it may be shut down before the function ends
    name : of the thread
    """
    future = Future(executor=executor)
    future.add_done_callback(lambda _: None)

    def work() -> None:
        try:
            settle = partial(future.set_result, function())
        except BaseException as error:  # raised where it is awaited
            settle = partial(future.set_exception, error)
        try:
            settle()
            if executor is not None:
                executor.wake()
        except AttributeError:
            # An executor that was shut down has no guard condition: the node has ended, and
            # nothing awaits the result. Fetched, an exception is not printed by rclpy.
            future.exception()

    threading.Thread(target=work, daemon=True, name=name).start()
    return future
