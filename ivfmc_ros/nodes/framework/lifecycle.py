# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Base class of nodes with a device: a managed lifecycle that survives errors in transitions."""

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

# Seconds between two attempts to configure and activate.
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
    A CellNode with the lifecycle of ROS 2 managed nodes.

    A subclass overrides ``on_configure(state)`` and the other transition callbacks. Returning
    None is success; a ScanError is failure (the state is kept), another exception an error (back
    to unconfigured). The exception is the fault 'lifecycle' in the diagnostics. With
    ``autostart`` the node configures and activates itself, repeatedly until it succeeds, or until
    a client calls change_state.
    """

    def __init__(self, name: str) -> None:
        CellNode.__init__(self, name)
        for transition in _TRANSITIONS:
            setattr(
                self, transition, self._guarded_transition(transition, getattr(self, transition))
            )
        LifecycleNodeMixin.__init__(self)
        self._change_state = self._service_change_state.callback
        self._service_change_state.callback = self._guarded_change
        self._autostart = self.parameter(
            'autostart', True, 'Configure and activate at the start.', read_only=True
        )
        self._autostart_timer = self.steady_timer(RETRY_S, self._bring_up)
        # the first attempt in the first spin, not a period later
        self._first_attempt = self.steady_timer(0.001, self._bring_up_first)

    @property
    def state(self) -> str:
        """Label of the current lifecycle state, such as 'active'."""
        return str(self._state_machine.current_state[1])

    def release_device(self) -> None:
        """Bring the device to a safe state and close it; idempotent; a subclass overrides it."""

    def on_deactivate(self, state: LifecycleState) -> Any:
        """Release the device."""
        self.release_device()
        return super().on_deactivate(state)

    def on_shutdown(self, state: LifecycleState) -> Any:
        """Release the device."""
        self.release_device()

    def on_error(self, state: LifecycleState) -> Any:
        """Release the device."""
        self.release_device()

    def fix_while_active(self, *names: str) -> None:
        """Reject changes of parameters that take effect at activation while the node is active."""

        def reject(values: Mapping[str, Any]) -> None:
            changed = [name for name in names if values[name] != self.get(name)]
            if changed and self.state == 'active':
                raise ParameterError(
                    f'{changed[0]}: takes effect at activation; deactivate the node first'
                )

        self.check(reject)

    def stop(self) -> None:
        """Release the device and shut the lifecycle down, in every state."""
        self.release_device()
        self._autostart = False
        if self.state in ('active', 'inactive', 'unconfigured'):
            self.trigger_shutdown()
        super().stop()

    def _bring_up_first(self) -> None:
        self._first_attempt.cancel()
        self._bring_up()

    def _bring_up(self) -> None:
        if self._autostart and self.state == 'unconfigured':
            self.trigger_configure()
        if self._autostart and self.state == 'inactive':
            self.trigger_activate()
        if not self._autostart or self.state == 'active':
            self._autostart_timer.cancel()

    def _guarded_transition(self, name: str, function: _Transition) -> _Transition:
        def transition(state: LifecycleState) -> TransitionCallbackReturn:
            try:
                result = function(state)
            except Exception as error:  # rclpy would discard it
                self.fault('lifecycle', error)
                known = isinstance(error, ScanError)
                results = TransitionCallbackReturn
                return results.FAILURE if known else results.ERROR
            if name != 'on_error':
                self.health.clear_fault('lifecycle')
            return TransitionCallbackReturn.SUCCESS if result is None else result

        return transition

    def _guarded_change(self, request: Any, response: Any) -> Any:
        self._autostart = False
        try:
            response = self._change_state(request, response)
        except (_RCLError, InvalidHandle) as error:
            requested = request.transition.label or request.transition.id
            self.get_logger().warning(
                f'change_state: transition {requested} is not possible in state {self.state}: '
                f'{" ".join(str(error).split())}'
            )
            response.success = False
        return response
