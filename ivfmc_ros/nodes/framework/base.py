# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Base class of all nodes: guarded callbacks, heartbeat, diagnostics, services with JSON responses.

An exception in a callback does not end a node. It becomes a condition in the diagnostics, or the
response of the service.
"""

from collections.abc import Awaitable
from collections.abc import Callable
from collections.abc import Sequence
from functools import partial
import inspect
import signal
import time
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
from rclpy.logging import get_logger
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from std_srvs.srv import Trigger

from ivfmc_ros.errors import ScanError
from ivfmc_ros.nodes.framework import environment
from ivfmc_ros.nodes.framework import qos
from ivfmc_ros.nodes.framework.executor import NodeExecutor
from ivfmc_ros.nodes.framework.health import Health
from ivfmc_ros.nodes.framework.health import Level
from ivfmc_ros.nodes.framework.health import WAITING
from ivfmc_ros.nodes.framework.json_response import Answer
from ivfmc_ros.nodes.framework.json_response import describe
from ivfmc_ros.nodes.framework.json_response import error_response
from ivfmc_ros.nodes.framework.json_response import success_response
from ivfmc_ros.nodes.framework.life import HEARTBEAT_S
from ivfmc_ros.nodes.framework.life import Life
from ivfmc_ros.nodes.framework.parameters import ParameterNode
from ivfmc_ros.nodes.framework.service_retry import retry_responses
from ivfmc_ros.nodes.framework.shutdown import flush
from ivfmc_ros.nodes.framework.shutdown import ShutdownRequest
from ivfmc_ros.nodes.framework.thread_work import start_thread

DIAGNOSTICS_S = 1.0

# Seconds from the start of a node within which a missing input is no warning. The slowest input
# of a cell is the simulated camera, which loads Open3D first: 5 to 15 s on two idle cores, several
# times that under load.
STARTUP_S = 60.0

# Exceptions in a row out of spin_once, without one success, after which the executor is broken.
_MAX_SPIN_FAILURES = 1000

Handler = Callable[[], Answer | Awaitable[Answer]]
Received = Callable[[], object]


class CellNode(ParameterNode):
    """
    A node of the cell.

    It publishes ``<node>/heartbeat`` at 6.7 Hz from a steady clock (ROS time may stand still) and
    its conditions on ``/diagnostics`` at 1 Hz, and it survives exceptions in its callbacks.
    """

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.steady_clock = Clock(clock_type=ClockType.STEADY_TIME)
        self.health = Health(self._log)
        self._activity = ''
        self._values: dict[str, Any] = {}
        self._inputs: list[tuple[str, Received, Callable[[], str], str]] = []
        # exceptions of callbacks that failed last time, by object and callback
        self._callback_faults: dict[str, dict[object, Exception]] = {}
        self._started_s = self.steady_s()
        # services may await without blocking timers or each other
        self._services_group = ReentrantCallbackGroup()
        self.life = Life(self, self.guarded(self.on_settled))
        # why the node ends, '' while it runs
        self.ending = ''
        self._diagnostics = self.create_publisher(
            DiagnosticArray,
            '/diagnostics',
            qos.reliable(10),
            event_callbacks=qos.NO_PUBLISHER_EVENTS,
        )
        self.steady_timer(HEARTBEAT_S, self._beat)
        self.steady_timer(DIAGNOSTICS_S, self.publish_diagnostics)

    def steady_timer(self, period_s: float, callback: Callable[[], object]) -> Any:
        """Return a timer on a clock that never jumps, with a guarded callback."""
        return self.create_timer(period_s, self.guarded(callback), clock=self.steady_clock)

    def later(self, delay_s: float, callback: Callable[[], object]) -> None:
        """Call ``callback`` once, ``delay_s`` seconds of the steady clock from now."""

        def once() -> None:
            timer.cancel()
            self.destroy_timer(timer)
            callback()

        timer = self.steady_timer(delay_s, once)

    def subscribe(self, kind: type, topic: str, callback: Callable[[Any], object]) -> Any:
        """Subscribe to a topic of this package, with the QoS that its node publishes with."""
        return self.create_subscription(
            kind,
            topic,
            self.guarded(callback, topic),
            qos.of_topic(topic),
            event_callbacks=qos.NO_SUBSCRIPTION_EVENTS,
        )

    def publish_on(self, kind: type, topic: str) -> Any:
        """Return a publisher with the QoS of the topic."""
        return self.create_publisher(
            kind, topic, qos.of_topic(topic), event_callbacks=qos.NO_PUBLISHER_EVENTS
        )

    def guarded(self, function: Callable[..., object], name: str = '') -> Callable[..., None]:
        """
        Return ``function`` as a callback whose exceptions become a fault in the diagnostics.

        The fault ends when the function returns again; it ends none of another callback.

        name : object of the fault, such as the topic; by default the function's name
        """
        subject = name or getattr(function, '__name__', type(function).__name__).strip('_')
        guard = object()
        faults = self._callback_faults.setdefault(subject, {})

        def callback(*arguments: Any) -> None:
            try:
                function(*arguments)
            except Exception as error:  # spin must go on
                faults[guard] = error
                self.fault(subject, error)
            else:
                if faults.pop(guard, None) is None:
                    return
                if faults:
                    self.fault(subject, next(iter(faults.values())))
                else:
                    self.health.clear_fault(subject)

        return callback

    def changed(self, function: Callable[[set[str]], None]) -> None:
        """Call a guarded ``function`` with the names of the parameters that have been set."""
        super().changed(self.guarded(function, 'parameters'))

    def fault(self, subject: str, error: BaseException) -> None:
        """
        Set an exception as the fault of an object (see ``Health.fault``).

        Its kind is the error code, or the type of an exception that is no ScanError; the message
        of the latter names the line of code.
        """
        kind = error.code if isinstance(error, ScanError) else type(error).__name__
        self.health.fault(subject, kind, describe(error))

    def status(self, activity: str, **values: Any) -> None:
        """
        Set what the node is doing, for diagnostics; logged when it changes.

        activity : a fixed text such as 'recording', without numbers
        values : key-value pairs of the diagnostics, kept until they are set again
        """
        self._values.update(values)
        if activity and activity != self._activity:
            self.get_logger().info(activity)
        self._activity = activity

    def expect(
        self, subject: str, received: Received, message: Callable[[], str], recovered: str
    ) -> None:
        """
        Report an input as a condition while it has not been received; checked at 1 Hz.

        It is information for the first ``STARTUP_S`` of the node, and a warning afterwards.

        subject : the input, such as a topic
        message : returns what the node waits for, and what the operator can do
        recovered : what the log says of ``subject`` when it has been received
        """
        self._inputs.append((subject, received, message, recovered))

    def waiting_level(self) -> Level:
        """Return the level of a condition that is normal only while the cell starts."""
        started = self.steady_s() - self._started_s > STARTUP_S
        return Level.WARN if started else Level.OK

    def trigger(self, name: str, handler: Handler, *, private: bool = True) -> Any:
        """
        Create a std_srvs/Trigger service that responds with one JSON object.

        handler : sync or async, returns the values beside ``"code": "OK"``
        private : below the node's name; otherwise directly in the namespace of the cell
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
        Create a service whose response has ``success`` and ``message`` (Trigger, SetBool).

        handler : takes the request; an exception becomes the response, with its code
        """

        async def answer(request: Any, response: Any) -> Any:
            try:
                # a second node of this name must not answer
                await self.life.settled()
                result = handler(request)
                if inspect.isawaitable(result):
                    result = await result
                response.success, response.message = True, success_response(result)
            except Exception as error:  # the client gets it
                self.get_logger().error(f'{name}: {describe(error)}')
                response.success, response.message = False, error_response(error)
            return response

        path = f'~/{name}' if private else name
        return self.create_service(kind, path, answer, callback_group=self._services_group)

    def in_thread(self, function: Callable[..., Any], *arguments: Any) -> Future:
        """
        Run ``function`` in a thread of its own and return a future to await.

        For work that blocks or releases the GIL, so that heartbeats go on. It must not use the
        node.
        """
        return start_thread(
            self.executor, f'{self.get_name()} work', partial(function, *arguments)
        )

    def now_ns(self) -> int:
        """Return the node's time, ROS time where use_sim_time is set, in nanoseconds."""
        return int(self.get_clock().now().nanoseconds)

    def steady_s(self) -> float:
        """Return the steady clock, seconds."""
        # that of ``steady_clock``, without its messages
        return time.monotonic()

    def on_settled(self) -> None:
        """Begin to act on the cell: there is no second node of this name; a subclass overrides."""

    def stop(self) -> None:
        """
        Clean up before the process ends; a subclass extends it.

        ``ending`` says why.
        """

    def on_beat(self) -> None:
        """Look after what needs no timer of its own, at each heartbeat; a subclass overrides."""

    def before_diagnosis(self) -> None:
        """Update ``status`` and conditions before they are published; a subclass overrides it."""

    def publish_diagnostics(self) -> None:
        """Publish the conditions now; a timer does so once a second."""
        self._check_inputs()
        self.before_diagnosis()
        self.health.log_ended()
        level, message = self.health.worst()
        self._send_diagnostics(level, message or self._activity or 'running')

    def say_end(self) -> None:
        """Publish why the node ends, as its last act."""
        name = ' (second node of this name)' if self.life.refusal else ''
        self._send_diagnostics(Level.ERROR, f'ended: {self.ending}', name)
        flush(self._diagnostics)

    def _beat(self) -> None:
        self.life.beat()
        self.on_beat()

    def _send_diagnostics(self, level: Level, message: str, suffix: str = '') -> None:
        values = {'status': self._activity, **self._values, **self.health.messages}
        status = DiagnosticStatus(
            level=bytes([level]),
            name=self.get_fully_qualified_name().lstrip('/') + suffix,
            message=message,
            hardware_id=self.get_namespace().strip('/'),
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(array)

    def _check_inputs(self) -> None:
        for subject, received, message, recovered in self._inputs:
            if received():
                self.health.clear(WAITING, subject)
            else:
                self.health.set(WAITING, subject, self.waiting_level(), message(), recovered)

    def _log(self, level: Level, line: str) -> None:
        logger = self.get_logger()
        # rclpy requires one place in the code for each severity
        if level is Level.ERROR:
            logger.error(line)
        elif level is Level.OK:
            logger.info(line)
        else:
            logger.warning(line)


def run(make: Callable[[], CellNode], arguments: Sequence[str] | None = None) -> int:
    """
    Run a node until SIGINT or SIGTERM.

    make : the node's class; called after rclpy.init
    returns : exit code: 0 after a signal, 1 when the executor failed, 2 when the node could not
        be created, or another of its name runs
    """
    environment.prepare()
    # own handlers: rclpy's shut the context down before a node can turn its lasers off
    rclpy.init(
        args=None if arguments is None else list(arguments),
        signal_handler_options=SignalHandlerOptions.NO,
    )
    shutdown = ShutdownRequest()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: shutdown.request(number))
    try:
        node = make()
    except ScanError as error:
        get_logger('ivfmc').fatal(f'cannot start: {error}')
        rclpy.try_shutdown()
        return 2
    for service in node.services:
        retry_responses(service, node.later)
    for line in node.unknown_parameters():
        # only a warning: one parameter file may serve several nodes
        node.get_logger().warning(line)
    executor = NodeExecutor()
    executor.add_node(node)
    try:
        code, node.ending = _spin(node, executor, shutdown)
        return code
    finally:
        _shut_down(node, executor)


def _spin(node: CellNode, executor: NodeExecutor, shutdown: ShutdownRequest) -> tuple[int, str]:
    """Return exit code and reason of the end."""
    failures = 0
    # the heartbeat timer returns from spin_once often enough to see the signal
    while not shutdown.reason and rclpy.ok():
        if node.life.refusal:
            node.get_logger().fatal(f'cannot start: {node.life.refusal}')
            return 2, node.life.refusal
        try:
            executor.spin_once(timeout_sec=0.5)
            failures = 0
        except (ExternalShutdownException, ShutdownException):
            break
        except Exception as error:  # one callback must not end a node
            node.fault('executor', error)
            failures += 1
            if failures > _MAX_SPIN_FAILURES:
                return 1, f'the executor failed: {describe(error)}'
    return 0, shutdown.reason or 'ROS was shut down'


def _shut_down(node: CellNode, executor: NodeExecutor) -> None:
    _call_safely(node, node.stop)
    _call_safely(node, node.say_end)
    # an executor that is still open at interpreter exit raises in its destructor
    _call_safely(node, lambda: executor.shutdown(timeout_sec=0.0))
    _call_safely(node, node.destroy_node)
    rclpy.try_shutdown()


def _call_safely(node: CellNode, function: Callable[[], Any]) -> None:
    try:
        function()
    except Exception as error:  # the remaining steps have to follow
        node.get_logger().error(f'shutdown: {describe(error)}')
