# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A client of the scan service with the stock interfaces that a cell controller has."""

from collections.abc import Callable
from collections.abc import Iterator
from contextlib import closing
from contextlib import contextmanager
import json
import time
from typing import Any

from ivfmc_ros.cli.support.cell_run import NODES
from ivfmc_ros.errors import HelperError
from ivfmc_ros.errors import ScanError
from ivfmc_ros.nodes.framework import environment

_SPIN_S = 0.1


@contextmanager
def cell_client(namespace: str) -> Iterator['CellClient']:
    """
    Yield a client of the cell in ``namespace``.

    :raises HelperError: ROS 2 is not installed
    """
    try:
        environment.prepare()
        import rclpy
        from rclpy.signals import SignalHandlerOptions
    except ImportError as error:
        raise HelperError(
            'NO_ROS',
            f'ROS 2 is needed: source a workspace, or pip install ivfmc_ros[ros] ({error})',
        ) from error
    # Ctrl-C is ours: it cancels the scan
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        with closing(CellClient(namespace)) as client:
            yield client
    finally:
        rclpy.try_shutdown()


class CellClient:
    """Calls services and follows ``scan_status``; one thread, no callbacks of its own."""

    def __init__(self, namespace: str) -> None:
        from diagnostic_msgs.msg import DiagnosticStatus
        import rclpy

        from ivfmc_ros.nodes.framework import qos
        from ivfmc_ros.nodes.framework.executor import NodeExecutor
        from ivfmc_ros.nodes.framework.heartbeats import Heartbeats

        self.status: dict[str, str] = {}
        self.node = rclpy.create_node(f'client_{time.time_ns() % 10**9}', namespace=namespace)
        self.namespace = namespace
        self._executor = NodeExecutor()
        self._executor.add_node(self.node)
        self._clients: dict[str, Any] = {}
        self.node.create_subscription(
            DiagnosticStatus, 'scan_status', self._hear, qos.of_topic('scan_status')
        )
        self._heard_s = time.monotonic()
        self._heartbeats = Heartbeats(self.node, ['orchestrator'], self._hear_heartbeat)

    @property
    def silent_s(self) -> float:
        """Seconds since the last heartbeat of the orchestrator."""
        self._heartbeats.fetch()
        return time.monotonic() - self._heard_s

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown(timeout_sec=0.0)
        self.node.destroy_node()

    def spin(self, seconds: float = _SPIN_S) -> None:
        """Process messages for at most ``seconds``."""
        self._executor.spin_once(timeout_sec=seconds)

    def until(self, condition: Callable[[], bool], seconds: float, what: str) -> None:
        """:raises HelperError: ``condition()`` was not true within ``seconds``."""
        deadline = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > deadline:
                raise HelperError('TIMEOUT', f'waited {seconds:.0f} s for {what}')
            self.spin()

    def trigger(self, name: str, seconds: float = 15.0) -> dict[str, Any]:
        """
        Call a Trigger below the namespace and return its answer.

        :raises HelperError: it refused, with its code, or is not there
        """
        from std_srvs.srv import Trigger

        response = self.call(name, Trigger, Trigger.Request(), seconds)
        try:
            answer = json.loads(response.message)
        except ValueError:
            answer = {'code': 'HELPER', 'detail': response.message}
        if not response.success:
            code, detail = str(answer.pop('code', '')), str(answer.pop('detail', ''))
            raise HelperError(code, f'{code}: {detail}', **answer)
        return dict(answer)

    @contextmanager
    def parameters(self, node: str, values: dict[str, Any]) -> Iterator[None]:
        """
        Set parameters of a node for the time of the block, then restore the former values.

        :raises ScanError: a parameter is unknown or was refused; nothing is changed then
        """
        if not values:
            yield
            return
        before = self._get(node, list(values))
        self.set_parameters(node, values)
        try:
            yield
        finally:
            self._set_messages(node, before)

    def _get(self, node: str, names: list[str]) -> list[Any]:
        from rcl_interfaces.msg import Parameter
        from rcl_interfaces.msg import ParameterType
        from rcl_interfaces.srv import GetParameters

        request = GetParameters.Request(names=names)
        found = self.call(f'{node}/get_parameters', GetParameters, request, 15.0).values
        unknown = [
            name
            for name, value in zip(names, found, strict=False)
            if value.type == ParameterType.PARAMETER_NOT_SET
        ]
        if unknown or len(found) != len(names):
            raise HelperError(
                'BAD_PARAMETER', f'{node}: has no parameter {", ".join(unknown or names)}'
            )
        return [Parameter(name=n, value=value) for n, value in zip(names, found, strict=True)]

    def set_parameters(self, node: str, values: dict[str, Any]) -> None:
        """
        Set all of the values or none.

        :raises ScanError: a parameter was refused, or the node is not there
        """
        from ivfmc_ros.nodes.framework.futures import parameter_message

        self._set_messages(
            node, [parameter_message(name, value) for name, value in values.items()]
        )

    def _set_messages(self, node: str, messages: list[Any]) -> None:
        from rcl_interfaces.srv import SetParametersAtomically

        request = SetParametersAtomically.Request(parameters=messages)
        service = f'{node}/set_parameters_atomically'
        result = self.call(service, SetParametersAtomically, request, 15.0).result
        if not result.successful:
            raise HelperError('BAD_PARAMETER', f'{node}: {result.reason}')

    def call(self, name: str, kind: Any, request: Any, seconds: float) -> Any:
        """:raises HelperError: the service is not there, or does not answer in time."""
        if name not in self._clients:
            self._clients[name] = self.node.create_client(kind, name)
        client = self._clients[name]
        place = f'{self.namespace}/{name}'
        self.until(client.service_is_ready, seconds, f'service {place}; is the cell up?')
        future = client.call_async(request)
        self.until(future.done, seconds, f'an answer of {place}')
        return future.result()

    @contextmanager
    def heartbeats(self) -> Iterator[Callable[[], set[str]]]:
        """Yield a function that returns the nodes of which a heartbeat came in the block."""
        from ivfmc_ros.nodes.framework.heartbeats import Heartbeats

        received: set[str] = set()
        heartbeats = Heartbeats(self.node, NODES, received.add)

        def found() -> set[str]:
            heartbeats.fetch()
            return received

        try:
            yield found
        finally:
            heartbeats.close()

    def _hear_heartbeat(self, _: str) -> None:
        self._heard_s = time.monotonic()

    def _hear(self, message: Any) -> None:
        self.status = {item.key: item.value for item in message.values}


def result_of(status: dict[str, str], scan_id: str) -> dict[str, Any] | None:
    """Return the answer of a scan if ``status`` is that of its end."""
    if status.get('scan_id') != scan_id or not status.get('result'):
        return None
    return dict(json.loads(status['result']))


def error_of(result: dict[str, Any]) -> ScanError:
    """Return the error for a bad answer."""
    return HelperError(str(result.get('code')), f'{result.get("code")}: {result.get("detail")}')
