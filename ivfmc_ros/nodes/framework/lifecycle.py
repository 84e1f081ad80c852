# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The base of nodes that hold a device: a lifecycle that no wrong transition can kill."""

from collections.abc import Callable
from collections.abc import Mapping
from typing import Any

from rclpy.exceptions import InvalidHandle
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNodeMixin
from rclpy.lifecycle import LifecycleState
from rclpy.lifecycle import TransitionCallbackReturn

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.errors import ScanError
from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.nodes.framework.health import Level

RETRY_S = 1.0

_RCLError = rclpy_implementation.RCLError
_Transition = Callable[[LifecycleState], TransitionCallbackReturn | None]
_TRANSITIONS = (
    'on_configure',
    'on_cleanup',
    'on_activate',
    'on_deactivate',
    'on_shutdown',
    'on_error',
)


class LifecycleCellNode(LifecycleNodeMixin, CellNode):
    """
    A CellNode with a lifecycle.

    A subclass overrides ``on_configure(state)`` and its kin. Returning nothing is success; a
    ScanError is failure (the state stays), anything else an error (back to unconfigured). What
    was raised is the diagnostic 'lifecycle'. With ``autostart`` the node configures and activates
    itself, and tries again while that fails, until somebody else takes its lifecycle in hand.
    """

    def __init__(self, name: str) -> None:
        CellNode.__init__(self, name)
        for transition in _TRANSITIONS:
            setattr(self, transition, self._reported(transition, getattr(self, transition)))
        LifecycleNodeMixin.__init__(self)
        self._change_state = self._service_change_state.callback
        self._service_change_state.callback = self._guarded_change
        self._own_hands = self.parameter(
            'autostart', True, 'Configure and activate without being told.', read_only=True
        )
        self._bring_up = self.steady_timer(RETRY_S, self._step_up)
        # the first step comes with the first spin, not a period later
        self._first_step = self.steady_timer(0.001, self._step_up_once)

    @property
    def state(self) -> str:
        """Label of the present state, such as 'active'."""
        return str(self._state_machine.current_state[1])

    def let_go(self) -> None:
        """Leave the device in order; a subclass says how, and may be asked again."""

    def on_deactivate(self, state: LifecycleState) -> Any:
        """Let the device go."""
        self.let_go()
        return super().on_deactivate(state)

    def on_shutdown(self, state: LifecycleState) -> Any:
        """Let the device go."""
        self.let_go()

    def on_error(self, state: LifecycleState) -> Any:
        """Let the device go."""
        self.let_go()

    def fix_while_active(self, *names: str) -> None:
        """Refuse to change parameters that are only looked at when the node is activated."""

        def refuse(values: Mapping[str, Any]) -> None:
            changed = [name for name in names if values[name] != self.get(name)]
            if changed and self.state == 'active':
                raise ParameterError(
                    f'{changed[0]}: counts when the node is activated; deactivate it first'
                )

        self.check(refuse)

    def stop(self) -> None:
        """Shut the lifecycle down; the device is left in order also where none was."""
        self.let_go()
        self._own_hands = False
        if self.state in ('active', 'inactive', 'unconfigured'):
            self.trigger_shutdown()
        super().stop()

    def _step_up_once(self) -> None:
        self._first_step.cancel()
        self._step_up()

    def _step_up(self) -> None:
        if self._own_hands and self.state == 'unconfigured':
            self.trigger_configure()
        if self._own_hands and self.state == 'inactive':
            self.trigger_activate()
        if not self._own_hands or self.state == 'active':
            self._bring_up.cancel()

    def _reported(self, name: str, function: _Transition) -> _Transition:
        def reported(state: LifecycleState) -> TransitionCallbackReturn:
            try:
                result = function(state)
            except Exception as error:  # rclpy would swallow it
                self.trouble('lifecycle', error)
                known = isinstance(error, ScanError)
                kinds = TransitionCallbackReturn
                return kinds.FAILURE if known else kinds.ERROR
            if name != 'on_error':
                self.health.clear('lifecycle')
            return TransitionCallbackReturn.SUCCESS if result is None else result

        return reported

    def _guarded_change(self, request: Any, response: Any) -> Any:
        self._own_hands = False
        try:
            response = self._change_state(request, response)
        except (_RCLError, InvalidHandle) as error:
            wanted = request.transition.label or request.transition.id
            self.get_logger().warning(
                f'transition {wanted} is not possible in state {self.state}: '
                f'{" ".join(str(error).split())}'
            )
            response.success = False
        if response.success:
            self.health.set('refused transition', Level.OK, '')
        return response
