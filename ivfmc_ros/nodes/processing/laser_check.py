# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Condition that a laser shines in the images although it is reported off."""

from collections.abc import Callable
from collections.abc import Sequence
from typing import Any

from ivfmc_ros.model import Frame
from ivfmc_ros.model import Image
from ivfmc_ros.model import Profile
from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.nodes.framework.health import Level
from ivfmc_ros.storage.matching.frame_matching import FrameMatch
from ivfmc_ros.storage.matching.laser_history import LASER_OFF
from ivfmc_ros.stripe.stuck_beam import StuckBeamCheck

_STUCK = 'stuck'


class LaserCheck:
    """
    Judges the images of a scan that were taken with all lasers off.

    stuck : message that names the laser which still shines; '' if none does
    """

    def __init__(self, node: CellNode, lasers: Callable[[], Sequence[str]]) -> None:
        """``lasers`` : returns their names, in the order of the cell."""
        self._node, self._lasers = node, lasers
        self.restart()

    def restart(self) -> None:
        """Begin a scan."""
        self._check = StuckBeamCheck()
        # whether an image with all lasers off has not been judged since the last lit one
        self._is_new = False
        self._update()

    @property
    def figures(self) -> dict[str, object]:
        """
        Key-value pairs for the diagnostics.

        dark_images_checked : images of the scan with all lasers off that could be judged
        dark_since_stamp : of the last such image that shows no laser
        """
        return {
            'laser_stuck': self.stuck,
            'dark_images_checked': self._check.checked,
            'dark_since_stamp': self._check.dark_ns,
        }

    def add_lit(self, frame: Frame, profile: Profile) -> None:
        """Keep the last image of a laser that is on."""
        self._is_new = True
        self._check.add_lit(frame, profile)

    def add_unused(self, match: FrameMatch, decode: Callable[[Any], Image]) -> None:
        """
        Judge an image that becomes no profile, if its lasers were off.

        The first dark image after a lit one settles it; only while images show a beam, more are
        compared.
        """
        if match.reason != LASER_OFF or not (self._is_new or self._check.stuck is not None):
            return
        before = self._check.stuck, self._check.dark_ns
        self._check.add_dark(decode(match.payload), match.angle, match.stamp_ns)
        if (self._check.stuck, self._check.dark_ns) != before:
            self._is_new = self._check.stuck is not None
            self._update()
            # the orchestrator must not wait for the next diagnostics of every second
            self._node.publish_diagnostics()

    def _update(self) -> None:
        stuck = self._check.stuck
        self.stuck = ''
        if stuck is None:
            self._node.health.clear(_STUCK, 'laser')
            return
        self.stuck = (
            f'laser {self._lasers()[stuck]} is reported off and shines in the images; cut its '
            'supply, then check relay and wiring'
        )
        self._node.health.set(_STUCK, 'laser', Level.ERROR, self.stuck, 'is off')
