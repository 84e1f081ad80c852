# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Coroutines of a node that wait for something to become true, without holding anything up."""

from collections.abc import Callable
from dataclasses import dataclass
import json
from typing import Any

from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import SetParameters
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.parameter import Parameter
from rclpy.parameter import parameter_value_to_python
from rclpy.task import Future
from std_srvs.srv import Trigger

from ivfmc_ros.errors import HelperError
from ivfmc_ros.errors import TimeoutExceededError
from ivfmc_ros.nodes.framework.base import CellNode

LOOK_S = 0.02

Condition = Callable[[], bool]


@dataclass(kw_only=True)
class _Wait:
    condition: Condition
    deadline: float
    what: str
    guard: Callable[[], None] | None
    future: Future


class Waiting:
    """
    What a node's coroutines wait for; a steady timer looks at all of it.

    guard : is called at every look and ends the wait by raising
    """

    def __init__(self, node: CellNode) -> None:
        self._node = node
        self._waits: list[_Wait] = []
        node.steady_timer(LOOK_S, self._look)

    async def until(
        self,
        condition: Condition,
        seconds: float,
        what: str,
        guard: Callable[[], None] | None = None,
    ) -> None:
        """
        Return when ``condition()`` is true.

        what : in the error, as 'the table to arrive'
        :raises TimeoutExceededError: it was not within ``seconds``
        """
        wait = _Wait(
            condition=condition,
            deadline=self._node.steady_s() + seconds,
            what=f'waited {seconds:.1f} s in vain for {what}',
            guard=guard,
            future=Future(executor=self._node.executor),
        )
        self._waits.append(wait)
        await wait.future

    async def pause(self, seconds: float) -> None:
        """Return after so many seconds."""
        end = self._node.steady_s() + seconds
        await self.until(lambda: self._node.steady_s() >= end, seconds + 1.0, 'nothing')

    def _look(self) -> None:
        for wait in list(self._waits):
            try:
                if wait.guard is not None:
                    wait.guard()
                ready = wait.condition()
                if not ready and self._node.steady_s() > wait.deadline:
                    raise TimeoutExceededError(wait.what)
            except Exception as error:  # raised where it is awaited
                self._waits.remove(wait)
                wait.future.set_exception(error)
            else:
                if ready:
                    self._waits.remove(wait)
                    wait.future.set_result(None)


class Helpers:
    """The services of the other nodes of a cell."""

    def __init__(self, node: CellNode, waiting: Waiting) -> None:
        self._node = node
        self.waiting = waiting
        self._group = ReentrantCallbackGroup()
        self._clients: dict[str, Any] = {}

    def has(self, path: str, kind: type = Trigger) -> bool:
        """Tell whether a service is there, such as 'turntable/home'; the first call says no."""
        return bool(self._client(path, kind).service_is_ready())

    async def trigger(
        self, path: str, seconds: float, guard: Callable[[], None] | None = None
    ) -> dict[str, Any]:
        """
        Call a std_srvs/Trigger of another node and return what it answers.

        :raises HelperError: it refused, with its own code; or it is not there, or silent
        """
        response = await self.call(path, Trigger, Trigger.Request(), seconds, guard)
        answer = _parsed(response.message)
        if not response.success:
            code = str(answer.get('code', 'HELPER'))
            detail = answer.get('detail') or response.message or 'no reason given'
            raise HelperError(code, f'{path}: {detail}')
        return answer

    async def set(self, node: str, values: dict[str, Any], seconds: float = 5.0) -> None:
        """
        Set parameters of another node.

        :raises HelperError: it refused one of them, is not there, or is silent
        """
        request = SetParameters.Request(
            parameters=[parameter_message(name, value) for name, value in values.items()]
        )
        response = await self.call(f'{node}/set_parameters', SetParameters, request, seconds)
        for name, result in zip(values, response.results, strict=True):
            if not result.successful:
                raise HelperError('BAD_PARAMETER', f'{node}: {name}: {result.reason}')

    async def call(
        self,
        path: str,
        kind: Any,
        request: Any,
        seconds: float,
        guard: Callable[[], None] | None = None,
    ) -> Any:
        """
        Call any service and return its response.

        :raises HelperError: it is not there, or does not answer within ``seconds``
        """
        client = self._client(path, kind)
        who = path.split('/', maxsplit=1)[0]
        try:
            await self.waiting.until(client.service_is_ready, 5.0, f'service {path}', guard)
            future = client.call_async(request)
            try:
                await self.waiting.until(future.done, seconds, f'an answer of {path}', guard)
            finally:
                # an answer that nobody waits for any more is not kept for ever
                client.remove_pending_request(future)
        except TimeoutExceededError as error:
            raise HelperError(f'{who.upper()}_LOST', str(error)) from error
        return future.result()

    def _client(self, path: str, kind: type) -> Any:
        if path not in self._clients:
            self._clients[path] = self._node.create_client(kind, path, callback_group=self._group)
        return self._clients[path]


def plain_parameters(names: list[str], values: list[Any]) -> dict[str, Any]:
    """Return rcl_interfaces values as plain ones by name; those that are not set are left out."""
    plain = {}
    for name, value in zip(names, values, strict=True):
        python = parameter_value_to_python(value)
        if python is not None:
            plain[name] = list(python) if hasattr(python, 'tolist') else python
    return plain


def _parsed(text: str) -> dict[str, Any]:
    try:
        answer = json.loads(text)
    except ValueError:
        return {}
    return answer if isinstance(answer, dict) else {}


def parameter_message(name: str, value: Any) -> ParameterMessage:
    """Return a parameter as a message; an empty list is one of names."""
    if isinstance(value, list | tuple) and not value:
        # an empty list has no type of its own
        return Parameter(name, Parameter.Type.STRING_ARRAY, []).to_parameter_msg()
    return Parameter(name, value=value).to_parameter_msg()
