# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Waits before a sweep until the stripe of a laser that was off no longer moves."""

import math

from ivfmc_ros.errors import HelperError
from ivfmc_ros.nodes.scanning.beam_control import Until
from ivfmc_ros.nodes.scanning.cell_link import CellLink
from ivfmc_ros.scan.plan import Sweep
from ivfmc_ros.stripe.stripe_motion import StripeRate
from ivfmc_ros.stripe.stripe_motion import WINDOW_S

# Pixels by which the stripe may move while a sweep is taken: as much as the noise of a point.
_MAX_SHIFT_PX = 0.1
# A laser that warms up slows down: its present rate is not that of a whole long sweep, nor of one
# in steps.
_LONGEST_SWEEP_S = 60.0
# Share of the time for which images have to show the stripe, for a rate to be said.
_KNOWN = 0.2
_NOT_AT_REST = 'NOT_AT_REST'


class WarmUp:
    """The part of ``scan.job.Tools`` that concerns cold lasers."""

    def __init__(self, link: CellLink, until: Until, scan_id: str, longest_s: float) -> None:
        """``longest_s`` : within which a laser is waited for, seconds."""
        self._link, self._until, self._scan_id = link, until, scan_id
        self._longest_s = longest_s

    async def wait(self, laser: str, index: int, sweep: Sweep) -> str:
        """
        Return when the stripe moves by less than a tenth of a pixel in a sweep, or after the time.

        laser, index : name of the laser that is on, and its index in the order of the cell
        sweep : that follows
        returns : what the stripe did at the end of the time; '' where it rests
        """
        moving_s = sweep.span / sweep.velocity if sweep.velocity else math.inf
        ahead_s = min(moving_s, _LONGEST_SWEEP_S)

        def rests() -> bool:
            found = self._rate_of(index)
            return found is not None and found.greatest_shift(ahead_s) < _MAX_SHIFT_PX

        try:
            await self._until(
                rests, self._longest_s, f'the stripe of laser {laser} to rest', _NOT_AT_REST
            )
        except HelperError as error:
            if error.code != _NOT_AT_REST:
                raise
            return self._text(laser, self._rate_of(index), ahead_s)
        return ''

    def _rate_of(self, index: int) -> StripeRate | None:
        found = self._link.diagnostics.stripe_rate(self._scan_id)
        return found if found is not None and found.laser == index else None

    def _text(self, laser: str, found: StripeRate | None, ahead_s: float) -> str:
        begin = f'warm_up: after {self._longest_s:g} s'
        if found is None:
            return f'{begin} nothing is known of laser {laser}: no two images show its stripe'
        if found.seconds < _KNOWN * min(WINDOW_S, self._longest_s):
            return f'{begin} laser {laser} is known for {found.seconds:.1f} s only'
        return (
            f'{begin} the stripe of laser {laser} moves by {60.0 * found.rate:+.2f} '
            f'+/- {120.0 * found.u:.2f} pixels a minute, up to '
            f'{found.greatest_shift(ahead_s):.2f} pixels in a sweep: wait longer, or leave the '
            'laser supplied between scans'
        )
