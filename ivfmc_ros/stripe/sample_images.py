# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Even selection of the images of a scan with their profiles, for the report."""

import math

from ivfmc_ros.model import Frame
from ivfmc_ros.model import Profile

# Number of tiles of the report's stripe sheet.
_SAMPLE_IMAGES = 12


class SampleImages:
    """Keeps an even selection of a stream of images; all of them would need gigabytes."""

    def __init__(self) -> None:
        self._kept: list[tuple[Frame, Profile]] = []
        self._stride = 1
        self._count = 0

    def add(self, frame: Frame, profile: Profile) -> None:
        """Offer the next image of the stream."""
        if self._count % self._stride == 0:
            self._kept.append((frame, profile))
        self._count += 1
        if len(self._kept) > 2 * _SAMPLE_IMAGES:
            self._kept = self._kept[::2]
            self._stride *= 2

    def chosen(self) -> list[tuple[Frame, Profile]]:
        """Return up to a dozen images with their profiles, in the order of the stream."""
        return self._kept[:: max(1, math.ceil(len(self._kept) / _SAMPLE_IMAGES))]
