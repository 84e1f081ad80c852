# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes as separate processes, and a plain rclpy client to talk to them."""

from collections.abc import Callable
from collections.abc import Iterator
from collections.abc import Mapping
from contextlib import contextmanager
import json
import os
from pathlib import Path
import signal
import subprocess
import sys
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.srv import SetParametersAtomically
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from ivfmc_ros.nodes.framework import environment
from ivfmc_ros.nodes.framework import qos
from support.answer_schema import require_valid

DOMAIN = 1 + os.getpid() % 100
ROOT = Path(__file__).resolve().parents[2]
NAMESPACE = '/ivfmc'
# Seconds; only a failing test waits this long. On a busy machine a node takes 20 s to start.
PATIENCE_S = 60.0
# Seconds without an answer after which a request is sent again.
_ANSWER_S = 10.0


def node_environment() -> dict[str, str]:
    """Environment of every process of a test, in a ROS domain of its own on this machine."""
    alone = {'ROS_DOMAIN_ID': str(DOMAIN), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
    found = environment.child_environment(**alone)
    paths = [str(ROOT), str(ROOT / 'test'), found.get('PYTHONPATH', '')]
    return {**found, 'PYTHONPATH': os.pathsep.join(paths)}


class NodeProcess:
    """A node in a process of its own."""

    def __init__(
        self, name: str, remappings: Mapping[str, str] | None = None, **parameters: Any
    ) -> None:
        arguments = [*self.command(name), '--ros-args']
        for before, after in (remappings or {}).items():
            arguments += ['-r', f'{before}:={after}']
        for key, value in parameters.items():
            text = value if isinstance(value, str) else json.dumps(value)
            arguments += ['-p', f'{key.replace("__", ".")}:={text}']
        self.process = subprocess.Popen(
            arguments,
            env=node_environment(),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        self.output = ''

    def command(self, name: str) -> list[str]:
        return [sys.executable, '-m', f'ivfmc_ros.nodes.{name}']

    @property
    def alive(self) -> bool:
        return self.process.poll() is None

    def end(self, number: int = signal.SIGINT) -> int:
        """Send a signal to the node, and return its exit code."""
        if self.alive:
            self.process.send_signal(number)
        try:
            self.output += self.process.communicate(timeout=30)[0] or ''
        except subprocess.TimeoutExpired:
            os.killpg(self.process.pid, signal.SIGKILL)
            self.output += self.process.communicate()[0] or ''
        return self.process.returncode


@contextmanager
def running(
    name: str, remappings: Mapping[str, str] | None = None, **parameters: Any
) -> Iterator[NodeProcess]:
    """A node that must still run at the end of the block, and exit with 0 after SIGINT."""
    node = NodeProcess(name, remappings, **parameters)
    try:
        yield node
        assert node.alive, node.end()
    finally:
        code = node.end()
        sys.stdout.write(node.output)
    assert code == 0, node.output


class Client:
    """A client of the cell that uses stock messages and services only."""

    def __init__(self) -> None:
        os.environ.update(node_environment())
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=DOMAIN)
        self.node = rclpy.create_node('client', namespace=NAMESPACE, context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self._diagnostics: dict[str, Any] = {}
        self.status: list[Any] = []
        self.node.create_subscription(
            DiagnosticArray, '/diagnostics', self._diagnose, qos.reliable(50)
        )

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)

    def until(
        self, condition: Callable[[], object], seconds: float = PATIENCE_S, what: str = ''
    ) -> None:
        """Spin until ``condition()`` is true; fails after ``seconds``."""
        deadline = time.monotonic() + seconds
        while not condition():
            diagnostics = [
                self.diagnostic(name) for name in ('triangulator', 'registrar', 'mesher')
            ]
            text = f'{what or "nothing"} within {seconds} s: {diagnostics}'
            assert time.monotonic() < deadline, text
            self.executor.spin_once(timeout_sec=0.02)

    def spin(self, seconds: float) -> None:
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            self.executor.spin_once(timeout_sec=0.02)

    def publisher(self, kind: type, topic: str, profile: Any = None) -> Any:
        return self.node.create_publisher(kind, topic, profile or qos.of_topic(topic))

    def collect(self, kind: type, topic: str, depth: int = 1000) -> list[Any]:
        """Return a list to which the messages of a topic are appended."""
        found: list[Any] = []
        profile = qos.of_topic(topic)
        profile.depth = depth
        self.node.create_subscription(kind, topic, found.append, profile)
        return found

    def call(self, kind: type, name: str, request: Any, seconds: float = PATIENCE_S) -> Any:
        with self._service(kind, name) as client:
            future = client.call_async(request)
            self.until(future.done, seconds, f'{name} does not answer')
            return future.result()

    def call_again(self, kind: type, name: str, request: Any) -> Any:
        """
        Call a service to which a request may come twice, until it answers.

        A request to a node that was killed, while the graph shows it still, is lost.
        """
        end_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < end_s:
            with self._service(kind, name) as client:
                future = client.call_async(request)
                again_s = time.monotonic() + _ANSWER_S
                self.until(lambda: future.done() or time.monotonic() > again_s)  # noqa: B023
                if future.done():
                    return future.result()
        raise AssertionError(f'{name} does not answer')

    @contextmanager
    def _service(self, kind: type, name: str) -> Iterator[Any]:
        """A client of a service that is there."""
        client = self.node.create_client(kind, name)
        try:
            self.until(client.service_is_ready, what=f'no service {name}')
            yield client
        finally:
            self.node.destroy_client(client)

    def trigger(self, name: str, seconds: float = PATIENCE_S) -> tuple[bool, dict[str, Any]]:
        answer = self.call(Trigger, name, Trigger.Request(), seconds)
        values = json.loads(answer.message)
        require_valid(name, answer.success, values)
        return answer.success, values

    def set(self, node: str, **values: Any) -> Any:
        """Set parameters together; a double underscore stands for a dot."""
        parameters = [
            Parameter(key.replace('__', '.'), value=value).to_parameter_msg()
            for key, value in values.items()
        ]
        request = SetParametersAtomically.Request(parameters=parameters)
        name = f'{node}/set_parameters_atomically'
        return self.call_again(SetParametersAtomically, name, request).result

    def diagnostic(self, node: str) -> str:
        """The last diagnostics of a node as one line: level, message, key-value pairs."""
        status = self._diagnostics.get(f'{NAMESPACE.strip("/")}/{node}')
        if status is None:
            return ''
        values = ' | '.join(f'{value.key}: {value.value}' for value in status.values)
        return f'{status.level[0]} {status.message} | {values}'

    def forget(self, node: str) -> None:
        """Forget the last diagnostics of a node that has ended."""
        self._diagnostics.pop(f'{NAMESPACE.strip("/")}/{node}', None)

    def _diagnose(self, message: DiagnosticArray) -> None:
        self._diagnostics.update({status.name: status for status in message.status})


@contextmanager
def following_client() -> Iterator[Client]:
    """A client with the list ``status`` of all messages of ``scan_status``."""
    client = Client()
    client.status = client.collect(DiagnosticStatus, 'scan_status')
    try:
        yield client
    finally:
        client.close()
