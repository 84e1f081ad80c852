# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Watches the images of a camera, on a steady clock: frozen, repeated, late, missing ones."""

from collections import Counter
import math
import time
import zlib

import numpy as np

from ivfmc_ros.devices.cameras.device import CameraImage
from ivfmc_ros.model import Image

# Images in a row that are equal to the last bit: read noise makes no two images equal, so that
# already the second one is suspicious, but a dark image without noise may be cut off at 0.
_FROZEN_AFTER = 5
# Frame periods between two images beyond which images are missing in between.
_MISSING_PERIODS = 1.75
# Seconds from the stamp of an image to its delivery beyond which it is late: a scan would match it
# with the positions of another stop.
_LATE_S = 0.5
# An image that is older than the one before by so many seconds: the clock was set back. No camera
# repeats an image so late, and one whose images were dropped would be silent for hours.
_SET_BACK_S = 1.0
_ROWS = 16  # every so manieth row of an image is compared


class FrameWatch:
    """
    Judges each image.

    counts : images by kind since the start: repeated, frozen, late, missing
    fault : why the images cannot be trusted, '' if they can
    """

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter(repeated=0, frozen=0, late=0, missing=0)
        self.fault = ''
        self.restart()

    def restart(self) -> None:
        """Forget the last image: the camera was opened again."""
        self._stamp_ns, self._arrived_at = -1, math.nan
        self._digest, self._equal = 0, 0

    def expect_pause(self) -> None:
        """Take the time until the next image for no gap: the camera begins or ends to rest."""
        self._arrived_at = math.nan

    def accepts(self, picture: CameraImage, period: float, now: float) -> bool:
        """
        Note an image; return whether it is a new one.

        period : seconds between images that the camera was asked for
        now : steady seconds
        """
        if 0 <= self._stamp_ns - picture.stamp_ns < _SET_BACK_S * 1e9:
            self.counts['repeated'] += 1
            return False
        self._stamp_ns = picture.stamp_ns
        gap, self._arrived_at = now - self._arrived_at, now
        if gap > _MISSING_PERIODS * period:
            self.counts['missing'] += round(gap / period) - 1
        if time.time_ns() - picture.stamp_ns > _LATE_S * 1e9:
            self.counts['late'] += 1
        self._compare(picture.image)
        return True

    def _compare(self, image: Image) -> None:
        rows = np.ascontiguousarray(image[::_ROWS])
        digest = zlib.adler32(rows.data)
        # nothing but one value: dark, or saturated
        flat = bool(rows.min() == rows.max())
        self._equal = self._equal + 1 if digest == self._digest and not flat else 0
        self._digest = digest
        if self._equal:
            self.counts['frozen'] += 1
        is_frozen = self._equal + 1 >= _FROZEN_AFTER
        self.fault = (
            f'the camera is frozen: its last {self._equal + 1} images are equal to the last bit'
            if is_frozen
            else ''
        )
