# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Waits for profiles of the triangulator, as long as there is progress.

The first profiles of a scan are published when there are enough images to resolve the automatic
settings, which a slow camera takes long for; profiles of a busy computer are late, but come.
"""

from itertools import pairwise

from ivfmc_ros.nodes.framework.futures import Condition
from ivfmc_ros.nodes.scanning.beam_control import Until
from ivfmc_ros.nodes.scanning.cell_link import CellLink
from ivfmc_ros.scan.table_reports import Standstill
from ivfmc_ros.stripe.stream import TUNING_IMAGES

# Profiles from which their rate is measured. The longest interval does not count: one lost image
# is not a slow camera.
_RATE_PROFILES = 8
# A low rate is measured again as long as it rises by this factor, at most so often: right after
# its start a cell still loads its libraries.
_RISE, _MAX_MEASUREMENTS = 1.1, 6


class ProfileWait:
    """The part of ``scan.job.Tools`` that concerns profiles."""

    def __init__(self, link: CellLink, until: Until, patience_s: float) -> None:
        """``patience_s`` : seconds without progress after which a wait fails."""
        self._link, self._until, self._patience_s = link, until, patience_s

    async def profile_at(self, view: int, standstill: Standstill) -> None:
        """
        Return when a profile of ``view`` that was taken at this standstill has been received.

        :raises HelperError: NO_PROFILE
        """

        def received() -> bool:
            heads = self._link.latest_profiles()
            return any(
                head.view == view and standstill.shows(head.angle, head.stamp_ns) for head in heads
            )

        await self._until_ready(received, view, f'a profile of view {view}')

    async def rate(self, view: int, enough: float) -> float:
        """
        Return the rate of the profiles of ``view``, 1/s.

        enough : rate that is not measured again
        :raises HelperError: NO_PROFILE
        """
        best, last_ns = 0.0, 0
        for _ in range(_MAX_MEASUREMENTS):
            measured, last_ns = await self._rate_after(view, last_ns)
            rises, best = measured > _RISE * best, max(measured, best)
            if best >= enough or not rises:
                break
        return best

    async def _rate_after(self, view: int, stamp_ns: int) -> tuple[float, int]:
        """Return the rate of the profiles after a stamp, and the stamp of the last of them."""

        def stamps_ns() -> list[int]:
            heads = self._link.latest_profiles()
            found = sorted(head.stamp_ns for head in heads if head.view == view)
            return [stamp for stamp in found if stamp > stamp_ns][-_RATE_PROFILES:]

        what = f'the first profiles of view {view}'
        await self._until_ready(lambda: len(stamps_ns()) == _RATE_PROFILES, view, what)
        stamps = stamps_ns()
        intervals = sorted(after - before for before, after in pairwise(stamps))[:-1]
        return len(intervals) / max(sum(intervals) * 1e-9, 1e-3), stamps[-1]

    async def _until_ready(self, ready: Condition, view: int, what: str) -> None:
        link = self._link
        begun = len(link.info_stamps_ns)

        def progress() -> tuple[int, int]:
            # both come to an end: the camera sends images also to a triangulator that hangs
            images = min(len(link.info_stamps_ns) - begun, TUNING_IMAGES)
            return images, sum(head.view == view for head in link.headers.values())

        while not ready():
            seen = progress()
            await self._until(
                lambda seen=seen: ready() or progress() != seen,  # type: ignore[misc]
                self._patience_s,
                what,
                'NO_PROFILE',
            )
