# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the images of a scan say beside their profiles: doubts for the diagnostics."""

from collections.abc import Callable
from collections.abc import Sequence
from typing import Any

from ivfmc_ros.model import Frame
from ivfmc_ros.model import Image
from ivfmc_ros.model import Profile
from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.nodes.framework.health import Level
from ivfmc_ros.nodes.processing.laser_check import LaserCheck
from ivfmc_ros.nodes.processing.stripe_rest import StripeRest
from ivfmc_ros.nodes.processing.volume_check import VolumeCheck
from ivfmc_ros.storage.matching.frame_matching import FrameMatch
from ivfmc_ros.stripe.acquisition import Acquisition

_FOCUS = 'focus'


class ImageChecks:
    """Lasers that shine on, stripes that move, a part that is cut, a focus that was changed."""

    def __init__(self, node: CellNode, lasers: Callable[[], Sequence[str]]) -> None:
        """``lasers`` : returns their names, in the order of the cell."""
        self._node = node
        self._laser, self._rest = LaserCheck(node, lasers), StripeRest(node)
        self._volume = VolumeCheck(node)
        self._focus = ''

    def restart(self) -> None:
        """Begin a scan."""
        self._laser.restart()
        self._rest.restart()

    def add_measured(self, frame: Frame, profile: Profile) -> None:
        """Look at an image that became a profile."""
        self._laser.add_lit(frame, profile)
        self._rest.add_measured(frame)

    def add_unused(self, match: FrameMatch, decode: Callable[[Any], Image]) -> None:
        """Look at an image that becomes no profile."""
        # first: the other one publishes the diagnostics of a dark image at once
        self._rest.add_unused(match, decode)
        self._laser.add_unused(match, decode)

    def update(self, acquisition: Acquisition | None) -> None:
        """Judge what an acquisition has counted."""
        self._volume.update(acquisition)
        found = acquisition.sheets() if acquisition is not None else None
        self._focus = found.advice if found is not None else ''
        if self._focus:
            self._node.health.set(_FOCUS, 'lasers', Level.WARN, self._focus)
        else:
            self._node.health.clear(_FOCUS, 'lasers')

    @property
    def figures(self) -> dict[str, object]:
        """Key-value pairs for the diagnostics."""
        return {
            'part_cut': self._volume.advice,
            'focus': self._focus,
            **self._laser.figures,
            **self._rest.figures,
        }
