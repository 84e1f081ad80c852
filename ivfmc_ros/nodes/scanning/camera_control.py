# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The camera of a scan: its calibration, and whether the table triggers its exposures."""

from collections.abc import Callable
from typing import Any

from sensor_msgs.msg import CameraInfo

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.nodes.framework.adaptive_subscription import AdaptiveSubscription
from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.nodes.framework.futures import ServiceClients
from ivfmc_ros.nodes.scanning.beam_control import Until

# Within which the first camera_info comes, seconds: on a busy machine.
_INFO_S = 15.0


class CameraControl:
    """
    The part of ``scan.job.Tools`` that concerns the camera.

    A triggered camera runs freely at standstill, where no trigger comes: the scan waits for images
    there, and looks for lasers that shine on.
    """

    def __init__(
        self,
        node: CellNode,
        services: ServiceClients,
        until: Until,
        guard: Callable[[], None],
        *,
        triggered: bool,
    ) -> None:
        """``triggered`` : whether the table triggers the camera in the sweeps of the scan."""
        self._node, self._services, self._until, self._guard = node, services, until, guard
        self._triggered = triggered
        self._is_on = False

    async def first_info(self) -> CameraInfo:
        """
        Return a message of ``camera_info``.

        :raises ParameterError: the camera is to be triggered and has no trigger line
        """
        if self._triggered:
            if not await self._services.get('camera', 'trigger', self._guard):
                raise ParameterError(
                    'trigger: the node camera has no trigger line, but cell.yaml has a '
                    'trigger_step; name the line (such as Line1) in its parameter trigger, or '
                    'remove trigger_step'
                )
            await self.trigger(on=False)
        got: list[Any] = []
        subscription = AdaptiveSubscription(self._node, CameraInfo, 'camera_info', got.append)
        try:
            await self._until(
                lambda: bool(got), _INFO_S, 'a message on camera_info', 'CAMERA_LOST'
            )
        finally:
            subscription.destroy()
        return got[0]

    async def trigger(self, *, on: bool) -> None:
        """Start each exposure by the table's trigger, or at the camera's own rate."""
        # before the call: after a time-out the camera may be triggered all the same
        self._is_on |= on
        await self._services.set('camera', {'triggered': on}, self._guard)
        self._is_on = on

    async def release(self) -> None:
        """Let the camera run freely again after a scan that was ended in a sweep."""
        if self._is_on:
            await self._services.set('camera', {'triggered': False})
