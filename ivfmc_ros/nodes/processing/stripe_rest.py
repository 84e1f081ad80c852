# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether the stripe rests: while a laser warms up, and after each stop of the table."""

from collections.abc import Callable
from typing import Any

from ivfmc_ros.model import Frame
from ivfmc_ros.model import Image
from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.nodes.framework.health import Level
from ivfmc_ros.storage.matching.frame_matching import FrameMatch
from ivfmc_ros.storage.matching.frame_matching import NOT_MEASURED
from ivfmc_ros.storage.matching.frame_matching import SAME_POSITION
from ivfmc_ros.storage.matching.laser_history import LASER_OFF
from ivfmc_ros.stripe.stripe_motion import StripeMotion

_UNSETTLED = 'unsettled'
# A later image of a stop shows that the stripe had not come to rest in the one that was measured
# if it moved by more pixels, and by more standard uncertainties.
_MIN_SHIFT_PX, _SIGNIFICANT = 0.1, 5.0
# Nanoseconds between images of a laser that waits: one that is always on also shines in a cell
# that rests.
_PERIOD_NS = 90_000_000


class StripeRest:
    """
    Judges images of one laser while the table stands.

    unsettled : what to do about a stripe that moves after the table has stopped; '' if it does not
    """

    def __init__(self, node: CellNode) -> None:
        self._node = node
        self.restart()

    def restart(self) -> None:
        """Begin a scan."""
        self._motion, self._warming = StripeMotion(), StripeMotion()
        self._looked_ns = 0
        # of the stops in step motion
        self._judged = self._moved = 0
        self._largest_px = 0.0
        self._is_judged = True
        self._update()

    def add_measured(self, frame: Frame) -> None:
        """Keep an image of step motion, to be compared with a later one of the same stop."""
        self._forget()
        if self._node.get('motion') == 'step' and not frame.bracket:
            self._motion.add(frame.image, frame.laser, frame.angle, frame.stamp_ns)
            self._is_judged = False

    def add_unused(self, match: FrameMatch, decode: Callable[[Any], Image]) -> None:
        """Judge an image that becomes no profile: of a laser that is on, or of none."""
        if match.reason == NOT_MEASURED:
            if 0 <= match.stamp_ns - self._looked_ns < _PERIOD_NS:
                return
            self._looked_ns = match.stamp_ns
            self._warming.add(decode(match.payload), match.laser, match.angle, match.stamp_ns)
        elif match.reason == LASER_OFF:
            self._forget()
        elif match.reason == SAME_POSITION and not self._is_judged:
            self._motion.add(decode(match.payload), match.laser, match.angle, match.stamp_ns)
            self._judge()

    def _forget(self) -> None:
        """Drop the images of a laser that waited: what they tell is not of its next wait."""
        if self._looked_ns:
            self._warming, self._looked_ns = StripeMotion(), 0

    def _judge(self) -> None:
        shift = self._motion.last
        if shift is None:
            return
        self._is_judged = True
        self._judged += 1
        if abs(shift.pixels) > max(_MIN_SHIFT_PX, _SIGNIFICANT * shift.u):
            self._moved += 1
            self._largest_px = max(self._largest_px, abs(shift.pixels))
        self._update()

    def _update(self) -> None:
        if not self._moved:
            self.unsettled = ''
            self._node.health.clear(_UNSETTLED, 'settle')
            return
        self.unsettled = (
            f'at {self._moved} of {self._judged} stops the stripe moved by up to '
            f'{self._largest_px:.2f} pixels after the measured image: raise settle of the '
            f'triangulator ({self._node.get("settle"):g} s), or fasten the part'
        )
        self._node.health.set(_UNSETTLED, 'settle', Level.WARN, self.unsettled, 'it rests')

    @property
    def figures(self) -> dict[str, object]:
        """Key-value pairs for the diagnostics; those of a laser that waits are '' without one."""
        found = self._warming.rate
        return {
            'unsettled': self.unsettled,
            'stripe_laser': found.laser if found else '',
            'stripe_seconds': found.seconds if found else '',
            'stripe_rate': found.rate if found else '',
            'stripe_rate_u': found.u if found else '',
        }
