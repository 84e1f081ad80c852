# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The camera of a scan: its calibration, its exposures, and whether the table triggers them."""

from collections.abc import Callable
from collections.abc import Iterable
from typing import Any

from sensor_msgs.msg import CameraInfo

from ivfmc_ros.errors import HelperError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.nodes.convert.stamps import nanoseconds
from ivfmc_ros.nodes.framework.adaptive_subscription import AdaptiveSubscription
from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.nodes.framework.futures import ServiceClients
from ivfmc_ros.nodes.scanning.beam_control import Until

# Within which the first camera_info comes, seconds: on a busy machine.
_INFO_S = 15.0
# Images after a change of the exposure time before one is sure to have the new one: a camera that
# exposes while it reads out has begun the next one.
_SETTLING_IMAGES = 3


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
        exposures: Iterable[float] = (),
    ) -> None:
        """
        Make the control of one scan.

        triggered : whether the table triggers the camera in the sweeps of the scan
        exposures : exposure times that the scan sets, seconds; 0 is none
        """
        self._node, self._services, self._until, self._guard = node, services, until, guard
        self._triggered = triggered
        self._is_on = False
        self._exposures = sorted({seconds for seconds in exposures if seconds})
        # parameter ``exposure`` of camera and triangulator before the scan
        self._own: dict[str, float] = {}
        self._exposure = 0.0

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

    async def require_exposures(self) -> None:
        """
        Try all exposure times of the scan, before the table turns.

        :raises ParameterError: the camera has no parameter for it
        :raises HelperError: it refuses one of them
        """
        if not self._exposures:
            return
        for node in ('camera', 'triangulator'):
            self._own[node] = await self._exposure_of(node)
        for seconds in self._exposures:
            await self._set_exposure(seconds)

    async def _exposure_of(self, node: str) -> float:
        try:
            own = await self._services.get(node, 'exposure', self._guard)
        except HelperError as error:
            # a driver of another name
            own, reason = None, f' ({error})'
        else:
            reason = ''
        if isinstance(own, float):
            return own
        raise ParameterError(
            f'exposures: the node {node} has no parameter exposure{reason}; leave exposures '
            'empty, and set the exposure time of the camera by its own means'
        )

    async def expose(self, seconds: float) -> None:
        """Set the exposure time; return when images with it have come. 0: leave it."""
        if not seconds or seconds == self._exposure:
            return
        await self._set_exposure(seconds)
        stamps: list[int] = []
        changed_ns = self._node.now_ns()

        def receive(info: CameraInfo) -> None:
            stamp_ns = nanoseconds(info.header.stamp)
            if stamp_ns > changed_ns:
                stamps.append(stamp_ns)

        subscription = AdaptiveSubscription(self._node, CameraInfo, 'camera_info', receive)
        try:
            await self._until(
                lambda: len(stamps) > _SETTLING_IMAGES,
                _INFO_S + _SETTLING_IMAGES * seconds,
                f'images with an exposure time of {1e3 * seconds:g} ms',
                'CAMERA_LOST',
            )
        finally:
            subscription.destroy()
        self._exposure = seconds

    async def _set_exposure(self, seconds: float) -> None:
        # before the call: after a time-out the camera may have it all the same
        self._exposure = 0.0
        await self._services.set('camera', {'exposure': seconds}, self._guard)
        # what is longer than this would count as exposed before a laser was switched
        matched = max(seconds, self._own['triangulator'])
        await self._services.set('triangulator', {'exposure': matched}, self._guard)

    async def trigger(self, *, on: bool) -> None:
        """Start each exposure by the table's trigger, or at the camera's own rate."""
        # before the call: after a time-out the camera may be triggered all the same
        self._is_on |= on
        await self._services.set('camera', {'triggered': on}, self._guard)
        self._is_on = on

    async def release(self) -> None:
        """Let the camera run freely, and with the exposure time that it had before the scan."""
        if self._is_on:
            self._is_on = False
            await self._services.set('camera', {'triggered': False})
        own, self._own = self._own, {}
        for node, seconds in own.items():
            await self._services.set(node, {'exposure': seconds})
