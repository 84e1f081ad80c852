# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The common base of all nodes: border, heartbeat, diagnostics, JSON answers.

A callback that raises never ends a node: the border turns the exception into a diagnostic, and
into the answer of a service.
"""

from collections.abc import Awaitable
from collections.abc import Callable
from collections.abc import Sequence
import inspect
import signal
import threading
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from diagnostic_msgs.msg import DiagnosticStatus
from diagnostic_msgs.msg import KeyValue
import rclpy
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock
from rclpy.clock import ClockType
from rclpy.executors import ExternalShutdownException
from rclpy.executors import ShutdownException
from rclpy.executors import SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from std_msgs.msg import Header
from std_srvs.srv import Trigger

from ivfmc_ros.errors import ScanError
from ivfmc_ros.nodes.framework import environment
from ivfmc_ros.nodes.framework import qos
from ivfmc_ros.nodes.framework.health import Health
from ivfmc_ros.nodes.framework.health import Level
from ivfmc_ros.nodes.framework.json_response import Answer
from ivfmc_ros.nodes.framework.json_response import describe
from ivfmc_ros.nodes.framework.json_response import ok
from ivfmc_ros.nodes.framework.json_response import refusal
from ivfmc_ros.nodes.framework.parameters import ParameterNode
from ivfmc_ros.nodes.framework.service_retry import persistent

HEARTBEAT_S = 0.1
DIAGNOSTICS_S = 1.0

# An executor that raises this often without doing anything in between is broken.
_HOPELESS = 1000
# Seconds that a node may take to end in order.
_PATIENCE = 20.0

Handler = Callable[[], Answer | Awaitable[Answer]]


class CellNode(ParameterNode):
    """
    A node of the cell.

    It beats on ``<node>/heartbeat`` from a steady clock (ROS time may stand still), says how it
    is on ``/diagnostics``, and survives whatever its callbacks raise.
    """

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.steady_clock = Clock(clock_type=ClockType.STEADY_TIME)
        self.health = Health(self._say)
        self._values: dict[str, Any] = {}
        # services may await without holding up timers and each other
        self._services_group = ReentrantCallbackGroup()
        self._beats = self.create_publisher(Header, '~/heartbeat', qos.reliable(10))
        self._diagnostics = self.create_publisher(
            DiagnosticArray, '/diagnostics', qos.reliable(10)
        )
        self.steady_timer(HEARTBEAT_S, self._beat)
        self.steady_timer(DIAGNOSTICS_S, self._diagnose)

    def steady_timer(self, period_s: float, callback: Callable[[], object]) -> Any:
        """Return a timer on a clock that never jumps; ``callback`` goes through the border."""
        return self.create_timer(period_s, self.border(callback), clock=self.steady_clock)

    def later(self, delay_s: float, callback: Callable[[], object]) -> None:
        """Call ``callback`` once, after so many seconds of the steady clock."""

        def once() -> None:
            timer.cancel()
            self.destroy_timer(timer)
            callback()

        timer = self.steady_timer(delay_s, once)

    def subscribe(
        self, kind: type, topic: str, callback: Callable[[Any], object], depth: int | None = None
    ) -> Any:
        """Subscribe one of our own topics, with the QoS it is published with."""
        profile = qos.of_topic(topic) if depth is None else qos.reliable(depth)
        return self.create_subscription(
            kind,
            topic,
            self.border(callback, topic),
            profile,
            event_callbacks=qos.NO_SUBSCRIPTION_EVENTS,
        )

    def publish_on(self, kind: type, topic: str) -> Any:
        """Return a publisher with the QoS of the topic."""
        return self.create_publisher(
            kind, topic, qos.of_topic(topic), event_callbacks=qos.NO_PUBLISHER_EVENTS
        )

    def border(self, function: Callable[..., object], name: str = '') -> Callable[..., None]:
        """
        Return ``function`` as a callback whose exceptions become a diagnostic.

        The trouble has the name ``name`` (by default the function's), is logged when it begins or
        changes, and is over when the function returns again.
        """
        named = name or getattr(function, '__name__', type(function).__name__).strip('_')

        def guarded(*arguments: Any) -> None:
            try:
                function(*arguments)
            except Exception as error:  # whatever it is, spin goes on
                self.trouble(named, error)
            else:
                self.health.clear(named)

        return guarded

    def trouble(self, name: str, error: BaseException) -> None:
        """State an exception as the condition ``name``; with its place unless a ScanError."""
        self.health.set(name, Level.ERROR, describe(error))

    def status(self, level: Level | int, message: str, **values: Any) -> None:
        """Say how the node is; ``values`` are kept until they are said again."""
        self._values.update(values)
        self.health.set('status', Level(level), message)

    def trigger(self, name: str, handler: Handler, *, private: bool = True) -> Any:
        """
        Offer a std_srvs/Trigger that answers with one JSON object.

        handler : sync or async, returns what stands beside ``"code": "OK"``
        private : below the node's name; otherwise at the top of the namespace
        """
        return self.service(Trigger, name, lambda _: handler(), private=private)

    def service(
        self,
        kind: type,
        name: str,
        handler: Callable[[Any], Answer | Awaitable[Answer]],
        *,
        private: bool = True,
    ) -> Any:
        """
        Offer a service whose response has ``success`` and ``message`` (Trigger, SetBool).

        handler : takes the request; what it raises is the answer, with its code
        """

        async def answer(request: Any, response: Any) -> Any:
            try:
                result = handler(request)
                if inspect.isawaitable(result):
                    result = await result
                response.success, response.message = True, ok(result)
            except Exception as error:  # the caller gets to know
                self.get_logger().error(f'{name}: {describe(error)}')
                response.success, response.message = False, refusal(error)
            return response

        path = f'~/{name}' if private else name
        return self.create_service(kind, path, answer, callback_group=self._services_group)

    def in_thread(self, function: Callable[..., Any], *arguments: Any) -> Future:
        """
        Run ``function`` in a thread of its own and return a future to await.

        For work that waits or releases the interpreter's lock, so that heartbeats go on. It must
        not touch the node.
        """
        future = Future(executor=self.executor)
        future.add_done_callback(lambda _: None)

        def work() -> None:
            try:
                result = function(*arguments)
            except BaseException as error:  # raised where it is awaited
                future.set_exception(error)
            else:
                future.set_result(result)
            self.wake()

        threading.Thread(target=work, daemon=True, name=f'{self.get_name()} work').start()
        return future

    def wake(self) -> None:
        """Let the executor look again at what is awaited; from any thread."""
        if self.executor is not None:
            self.executor.wake()

    def now_ns(self) -> int:
        """Return the node's time, ROS time where use_sim_time is set, in nanoseconds."""
        return int(self.get_clock().now().nanoseconds)

    def steady_s(self) -> float:
        """Return seconds of a clock that never jumps."""
        return float(self.steady_clock.now().nanoseconds) * 1e-9

    def stop(self) -> None:
        """Clean up before the process ends; a subclass adds to it."""

    def _beat(self) -> None:
        header = Header(frame_id=self.get_name())
        header.stamp = self.get_clock().now().to_msg()
        self._beats.publish(header)

    def _diagnose(self) -> None:
        self.before_diagnosis()
        level, message = self.health.worst()
        values = {**self._values, **self.health.conditions}
        status = DiagnosticStatus(
            level=bytes([level]),
            name=self.get_fully_qualified_name().lstrip('/'),
            message=message or 'running',
            hardware_id=self.get_namespace().strip('/'),
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)

    def before_diagnosis(self) -> None:
        """Bring ``status`` up to date; a subclass overrides it."""

    def _say(self, name: str, level: Level, message: str) -> None:
        logger = self.get_logger()
        told = name == 'status' or message.startswith(name)
        text = message if told else f'{name}: {message}'
        # rclpy wants one place in the code for each severity
        if level is Level.ERROR:
            logger.error(text)
        elif level is Level.OK:
            logger.info(text)
        else:
            logger.warning(text)


def run(make: Callable[[], CellNode], arguments: Sequence[str] | None = None) -> int:
    """
    Run a node until it is told to end.

    make : the node's class; called after ROS is up
    returns : the exit code: 0 in order, 1 the executor broke, 2 the node refused to start
    """
    environment.prepare()
    # our own handlers: with rclpy's, ROS is gone before a node can turn its lasers off
    rclpy.init(
        args=None if arguments is None else list(arguments),
        signal_handler_options=SignalHandlerOptions.NO,
    )
    ending = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: _begin_to_end(ending))
    try:
        node = make()
    except ScanError as error:
        get_logger('ivfmc').fatal(f'does not start: {error}')
        rclpy.try_shutdown()
        return 2
    for service in node.services:
        persistent(service, node.later)
    for line in node.unknown():
        # a file of parameters may serve several nodes, and is no reason not to start
        node.get_logger().warning(line)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        return _spin(node, executor, ending)
    finally:
        _end(node, executor)


def _begin_to_end(ending: threading.Event) -> None:
    """End in order; whatever hangs on the way must not keep an orphan alive."""
    if not ending.is_set():
        ending.set()
        # by the kernel: a thread would not be started, or not run, where the interpreter hangs
        signal.setitimer(signal.ITIMER_REAL, _PATIENCE)


def _spin(node: CellNode, executor: SingleThreadedExecutor, ending: threading.Event) -> int:
    failures = 0
    # the heartbeat wakes this loop often enough to see the signal
    while not ending.is_set() and rclpy.ok():
        try:
            executor.spin_once(timeout_sec=0.5)
            failures = 0
        except (ExternalShutdownException, ShutdownException):
            break
        except Exception as error:  # one callback must not end a node
            node.trouble('executor', error)
            failures += 1
            if failures > _HOPELESS:
                return 1
    return 0


def _end(node: CellNode, executor: SingleThreadedExecutor) -> None:
    _quietly(node, node.stop)
    # one that is still open when the interpreter goes raises out of its destructor
    _quietly(node, lambda: executor.shutdown(timeout_sec=0.0))
    _quietly(node, node.destroy_node)
    rclpy.try_shutdown()


def _quietly(node: CellNode, function: Callable[[], Any]) -> None:
    try:
        function()
    except Exception as error:  # the end is near, and all of it is wanted
        node.get_logger().error(f'at the end: {describe(error)}')
