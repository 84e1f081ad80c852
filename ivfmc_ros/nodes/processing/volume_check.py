# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Condition that the working volume cuts the part, with the volume that would hold it."""

from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.nodes.framework.health import Level
from ivfmc_ros.stripe.acquisition import Acquisition

_CLIPPED = 'part cut'
# The volume is searched again when the images that are cut have become so many times more.
_MORE = 2


class VolumeCheck:
    """
    Judges the images of a scan that an acquisition has counted.

    advice : how the working volume cuts the part; '' if it does not
    """

    def __init__(self, node: CellNode) -> None:
        self.advice = ''
        self._node = node
        self._acquisition: Acquisition | None = None
        self._searched_at = 0
        self._searching = False

    def update(self, acquisition: Acquisition | None) -> None:
        """Set or clear the condition; the volume that would hold the part is found in a thread."""
        if acquisition is not self._acquisition:
            self._acquisition, self._searched_at, self.advice = acquisition, 0, ''
        found = acquisition.clipping() if acquisition is not None else None
        if acquisition is None or found is None:
            self.advice = ''
            self._node.health.clear(_CLIPPED, 'volume')
            return
        self.advice = self.advice or found.advice
        self._node.health.set(_CLIPPED, 'volume', Level.WARN, self.advice)
        count = acquisition.counts.cut_radius + acquisition.counts.cut_top
        if not self._searching and count >= _MORE * self._searched_at:
            self._searched_at, self._searching = count, True
            self._node.executor.create_task(self._search, acquisition)

    async def _search(self, acquisition: Acquisition) -> None:
        try:
            found = await self._node.in_thread(acquisition.clipping_with_extent)
            if found is not None and acquisition is self._acquisition:
                self.advice = found.advice
        finally:
            self._searching = False
