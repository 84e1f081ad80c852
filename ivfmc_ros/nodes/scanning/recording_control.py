# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Starts and stops the recorder for a scan."""

from collections.abc import Mapping
from typing import Any

from ivfmc_ros.errors import BusyError
from ivfmc_ros.errors import HelperError
from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.nodes.framework.futures import ServiceClients
from ivfmc_ros.nodes.scanning.cell_link import CellLink
from ivfmc_ros.nodes.scanning.scan_guard import ScanGuard

# Time-outs, seconds: of a new bag; of one that is read as a whole, to go on or to be closed.
_START_S = 15.0
_WHOLE_BAG_S = 120.0


class RecordingControl:
    """The part of ``scan.job.Tools`` that concerns the recorder."""

    def __init__(
        self,
        node: CellNode,
        link: CellLink,
        services: ServiceClients,
        guard: ScanGuard,
        *,
        resumed: bool,
    ) -> None:
        """``resumed`` : the bag of an interrupted scan is gone on with."""
        self._node, self._link, self._services, self._guard = node, link, services, guard
        self._start_s = _WHOLE_BAG_S if resumed else _START_S

    async def start(self) -> None:
        """Start the recorder; a recording of an orchestrator that died is stopped before."""
        # before the call: after a time-out the recorder may record all the same
        self._guard.recording = True
        try:
            await self._services.trigger('recorder/start', self._start_s, self._guard)
        except HelperError as error:
            if error.code != BusyError.code:
                raise
            self._node.get_logger().warning(f'{error}; stopping that recording')
            await self.stop()
            self._guard.recording = True
            await self._services.trigger('recorder/start', self._start_s, self._guard)

    async def stop(self, seconds: float = _WHOLE_BAG_S) -> Mapping[str, Any]:
        """Close the bag; return the recorder's response."""
        self._guard.recording = False
        return await self._services.trigger(
            'recorder/stop', seconds, lambda: self._link.watch.require_alive(['recorder'])
        )
