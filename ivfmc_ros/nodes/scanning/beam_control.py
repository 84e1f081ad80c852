# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Switches the lasers for a scan, and waits for the images that show it."""

from collections.abc import Awaitable
from collections.abc import Callable

from ivfmc_ros.errors import HelperError
from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.nodes.framework.futures import Condition
from ivfmc_ros.nodes.scanning.cell_link import CellLink

# Until a laser reports what was commanded, seconds.
_LASER_S = 10.0
# Time after standstill until a dark frame is accepted, ns: above ``settle`` of the triangulator.
_SETTLE_NS = 200_000_000
# Within which the triangulator says that no laser shines, seconds: above the time after which one
# is stuck (``stripe.stuck_beam``), and the period of the diagnostics.
_DARK_S = 5.0

_NO_DARK_IMAGE = 'NO_DARK_IMAGE'

# Waits for a condition: seconds, what is awaited, and the error code after that time.
Until = Callable[[Condition, float, str, str], Awaitable[None]]


class BeamControl:
    """The part of ``scan.job.Tools`` that concerns the lasers."""

    def __init__(
        self, node: CellNode, link: CellLink, until: Until, patience_s: float, scan_id: str
    ) -> None:
        """``patience_s`` : within which an image comes, seconds."""
        self._node, self._link, self._until = node, link, until
        self._patience_s, self._scan_id = patience_s, scan_id

    async def turn_on(self, laser: str) -> None:
        """Switch this laser on and all others off; return when that is reported."""
        self._link.hold(laser)
        await self._until(
            lambda: self._link.is_on(laser), _LASER_S, f'laser {laser} to be on', 'LASER_FAILED'
        )

    async def take_dark_frame(self, standstill_ns: int) -> None:
        """Return when an image was exposed with all lasers off, some time after standstill."""
        # the triangulator accepts it only then
        begin = max(await self._dark_since_ns(), standstill_ns + _SETTLE_NS)
        await self._until(
            lambda: self._link.last_image_ns >= begin,
            self._patience_s,
            'a dark image',
            'CAMERA_LOST',
        )

    async def check_off(self) -> None:
        """
        Return when the triangulator has an image in which no laser shines.

        One that shines on is a fault of the scan, which ends the wait. Where the triangulator does
        not follow laser_states, no image tells, and the scan goes on.
        """
        if not self._node.count_publishers('laser_states') or not self._link.headers:
            return
        since = await self._dark_since_ns()
        try:
            await self._until(
                lambda: self._link.diagnostics.dark_ns(self._scan_id) >= since,
                _DARK_S,
                'an image in which no laser shines',
                _NO_DARK_IMAGE,
            )
        except HelperError as error:
            if error.code != _NO_DARK_IMAGE:
                raise
            self._node.get_logger().warning(f'{error}: whether the lasers are off was not seen')

    async def _dark_since_ns(self) -> int:
        """Return the stamp since which all lasers are reported off, nanoseconds."""
        link = self._link
        await self._until(
            lambda: link.dark_since_ns is not None,
            _LASER_S,
            'all lasers to be off',
            'LASER_FAILED',
        )
        return link.dark_since_ns or 0
