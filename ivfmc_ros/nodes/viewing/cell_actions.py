# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Requests of a page to the cell, by the services that any client has."""

from collections.abc import Awaitable
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

from std_srvs.srv import SetBool
from trajectory_msgs.msg import JointTrajectory

from ivfmc_ros.errors import HelperError
from ivfmc_ros.errors import NotReadyError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.errors import StateError
from ivfmc_ros.nodes.convert.trajectory import trajectory_to
from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.nodes.framework.futures import ServiceClients
from ivfmc_ros.nodes.framework.futures import Waiter

_ANSWER_S = 15.0
# Of a table that is turned by hand, rad/s.
_JOG_SPEED = 0.5
_CONTROLS = ('pause', 'resume', 'cancel')


class CellActions:
    """
    Implements ``window.actions.Actions``; its methods may be called from any thread.

    position : of the table, radians; None while it is not known
    idle : no scan runs; only then a person may turn the table or turn a laser on. The buttons are
        disabled too, but a browser need not heed that
    """

    def __init__(self, node: CellNode) -> None:
        self.position: float | None = None
        self.idle = False
        self._node = node
        self._services = ServiceClients(node, Waiter(node))
        self._trajectory = node.publish_on(JointTrajectory, 'joint_trajectory')
        # discovery starts with the first call
        for name in ('start_scan', *_CONTROLS):
            self._services.has(name)

    def start(self, values: dict[str, Any]) -> 'Future[Any]':
        """Start a scan with these parameters, which hold for this scan only."""
        return self._submit(lambda: self._start(values))

    def control(self, request: str) -> 'Future[Any]':
        """Pause, resume or cancel the scan."""
        if request not in _CONTROLS:
            raise ParameterError(f'request {request!r}: is none of {", ".join(_CONTROLS)}')
        return self._submit(lambda: self._services.trigger(request, _ANSWER_S))

    def set_value(self, node: str, name: str, value: float) -> 'Future[Any]':
        """Set a parameter of a node."""
        return self._submit(lambda: self._services.set(node, {name: value}))

    def light(self, laser: str, on: bool) -> 'Future[Any]':
        """Switch a laser by hand."""
        return self._submit(lambda: self._light(laser, on))

    def jog(self, radians: float) -> 'Future[Any]':
        """Turn the table by an angle."""
        return self._submit(lambda: self._jog(radians))

    async def read(self, node: str, name: str) -> Any:
        """Return a parameter of a node; for coroutines of the own node."""
        return await self._services.get(node, name)

    async def _start(self, values: dict[str, Any]) -> dict[str, Any]:
        before = {name: await self._services.get('orchestrator', name) for name in values}
        try:
            # within: of several values one may be refused after others were set
            await self._services.set('orchestrator', values)
            return await self._services.trigger('start_scan', _ANSWER_S)
        finally:
            await self._services.set('orchestrator', before)

    def _require_idle(self) -> None:
        if not self.idle:
            raise StateError(
                'a scan runs; by hand the table turns, and a laser shines, in an idle cell'
            )

    async def _light(self, laser: str, on: bool) -> dict[str, Any]:
        self._require_idle()
        path = f'turntable/{laser}/enable'
        response = await self._services.call(path, SetBool, SetBool.Request(data=on), _ANSWER_S)
        if not response.success:
            raise HelperError('DEVICE', response.message)
        return {}

    async def _jog(self, radians: float) -> dict[str, Any]:
        self._require_idle()
        if self.position is None:
            raise NotReadyError('the position of the table is not known')
        seconds = abs(radians) / _JOG_SPEED
        target = self.position + radians
        self._trajectory.publish(trajectory_to(self._node.get('joint'), target, seconds))
        return {}

    def _submit(self, make: Callable[[], Awaitable[Any]]) -> 'Future[Any]':
        """Run a coroutine in the executor of the node; the calling thread gets a future."""
        future: Future[Any] = Future()

        async def work() -> None:
            try:
                future.set_result(await make())
            except Exception as error:  # the person who asked gets it
                future.set_exception(error)

        self._node.executor.create_task(work)
        return future
