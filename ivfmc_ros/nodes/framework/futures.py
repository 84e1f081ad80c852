# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Awaiting conditions and services of other nodes in the coroutines of a node.

Nothing here blocks the executor: ``Client.call()`` or a nested spin in a callback would deadlock.
"""

from collections.abc import Callable
from dataclasses import dataclass
import json
from typing import Any

from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import GetParameters
from rcl_interfaces.srv import SetParameters
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.parameter import Parameter
from rclpy.parameter import parameter_value_to_python
from rclpy.task import Future
from std_srvs.srv import Trigger

from ivfmc_ros.errors import HelperError
from ivfmc_ros.errors import TimeoutExceededError
from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.scan.liveness import AttentiveClock

# Seconds between two checks of the conditions.
POLL_S = 0.02
# A poll that comes later than this and as much again, seconds, is of a node that was stopped.
_MAX_LATE_S = 0.5
# Seconds to wait for a service of another node to be discovered.
_DISCOVERY_S = 5.0
# Seconds to wait for the response of a parameter service.
_PARAMETERS_S = 5.0

Condition = Callable[[], bool]


@dataclass(kw_only=True)
class _Wait:
    condition: Condition
    deadline: float
    timeout_text: str
    guard: Callable[[], None] | None
    future: Future


class Waiter:
    """
    Lets coroutines of a node await conditions, which a steady timer polls while there are some.

    Time in which the node itself was stopped counts towards no time-out: the messages of that
    time are still in its queues.
    """

    def __init__(self, node: CellNode) -> None:
        self._node = node
        self._waits: list[_Wait] = []
        self._clock = AttentiveClock(_MAX_LATE_S, node.steady_s)
        self._timer = node.steady_timer(POLL_S, self._poll)
        self._timer.cancel()

    async def until(
        self,
        condition: Condition,
        seconds: float,
        what: str,
        guard: Callable[[], None] | None = None,
    ) -> None:
        """
        Return when ``condition()`` is true.

        what : named in the error, such as 'the table to arrive'
        guard : called at every poll; an exception that it raises ends the wait
        :raises TimeoutExceededError: the condition was not true within ``seconds``
        """
        wait = _Wait(
            condition=condition,
            deadline=self._clock() + seconds,
            timeout_text=f'timed out after {seconds:.1f} s while waiting for {what}',
            guard=guard,
            future=Future(executor=self._node.executor),
        )
        self._waits.append(wait)
        if self._timer.is_canceled():
            self._timer.reset()
        await wait.future

    def _poll(self) -> None:
        self._clock.tick()
        for wait in list(self._waits):
            try:
                if wait.guard is not None:
                    wait.guard()
                ready = wait.condition()
                if not ready and self._clock() > wait.deadline:
                    raise TimeoutExceededError(wait.timeout_text)
            except Exception as error:  # raised where it is awaited
                self._waits.remove(wait)
                wait.future.set_exception(error)
            else:
                if ready:
                    self._waits.remove(wait)
                    wait.future.set_result(None)
        if not self._waits:
            self._timer.cancel()


class ServiceClients:
    """Clients of the services of the other nodes of a cell, created at the first use."""

    def __init__(self, node: CellNode, waiter: Waiter) -> None:
        self._node = node
        self.waiter = waiter
        self._group = ReentrantCallbackGroup()
        self._clients: dict[str, Any] = {}

    def has(self, path: str, kind: type = Trigger) -> bool:
        """
        Return whether a service such as 'turntable/home' is available.

        False at the first call, which creates the client: discovery takes a moment.
        """
        return bool(self._client(path, kind).service_is_ready())

    async def trigger(
        self, path: str, seconds: float, guard: Callable[[], None] | None = None
    ) -> dict[str, Any]:
        """
        Call a std_srvs/Trigger service of another node and return the JSON of its response.

        :raises HelperError: it failed, with its own code; or it is not available, or times out
        """
        response = await self.call(path, Trigger, Trigger.Request(), seconds, guard)
        answer = _parse_json(response.message)
        if not response.success:
            code = str(answer.get('code', 'HELPER'))
            detail = answer.get('detail') or response.message or 'no reason given'
            raise HelperError(code, f'{path}: {detail}')
        return answer

    async def set(
        self, node: str, values: dict[str, Any], guard: Callable[[], None] | None = None
    ) -> None:
        """
        Set parameters of another node.

        guard : see ``Waiter.until``
        :raises HelperError: it rejected one of them, is not available, or times out
        """
        request = SetParameters.Request(
            parameters=[parameter_message(name, value) for name, value in values.items()]
        )
        path = f'{node}/set_parameters'
        response = await self.call(path, SetParameters, request, _PARAMETERS_S, guard)
        for name, result in zip(values, response.results, strict=True):
            if not result.successful:
                raise HelperError('BAD_PARAMETER', f'{node}: {name}: {result.reason}')

    async def get(self, node: str, name: str, guard: Callable[[], None] | None = None) -> Any:
        """
        Return a parameter of another node, None if it has none of that name.

        guard : see ``Waiter.until``
        :raises HelperError: it is not available, or times out
        """
        request = GetParameters.Request(names=[name])
        path = f'{node}/get_parameters'
        response = await self.call(path, GetParameters, request, _PARAMETERS_S, guard)
        return parameter_value_to_python(response.values[0]) if response.values else None

    async def call(
        self,
        path: str,
        kind: Any,
        request: Any,
        seconds: float,
        guard: Callable[[], None] | None = None,
    ) -> Any:
        """
        Call a service of any type and return its response.

        seconds : time-out of the response
        guard : see ``Waiter.until``
        :raises HelperError: it is not available, or does not respond in time; the code is that
            of a lost node, such as MESHER_LOST
        """
        client = self._client(path, kind)
        node = path.split('/', maxsplit=1)[0]
        try:
            await self.waiter.until(
                client.service_is_ready, _DISCOVERY_S, f'service {path}', guard
            )
            future = client.call_async(request)
            try:
                await self.waiter.until(future.done, seconds, f'the response of {path}', guard)
            finally:
                # otherwise the client keeps a response that comes late
                client.remove_pending_request(future)
        except TimeoutExceededError as error:
            raise HelperError(f'{node.upper()}_LOST', str(error)) from error
        return future.result()

    def _client(self, path: str, kind: type) -> Any:
        if path not in self._clients:
            self._clients[path] = self._node.create_client(kind, path, callback_group=self._group)
        return self._clients[path]


def _parse_json(text: str) -> dict[str, Any]:
    try:
        answer = json.loads(text)
    except ValueError:
        return {}
    return answer if isinstance(answer, dict) else {}


def parameter_message(name: str, value: Any) -> ParameterMessage:
    """Return a parameter as rcl_interfaces/Parameter; an empty list becomes a string array."""
    if isinstance(value, list | tuple) and not value:
        # the type of its elements cannot be inferred
        return Parameter(name, Parameter.Type.STRING_ARRAY, []).to_parameter_msg()
    return Parameter(name, value=value).to_parameter_msg()
