# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Counts the images of a camera that were not received, by the stamps of those that were."""

from bisect import bisect_left
from collections import deque
from itertools import islice
from statistics import median

# An image and its camera_info may be received this far apart, in stamps of the camera, ns.
_LATE_NS = 1_000_000_000
# Spacings of images whose median is the frame period, and the least number of them.
_SPACINGS, _MIN_SPACINGS = 31, 5
# Spacing in frame periods from which an image is missing.
_MISSING_PERIODS = 1.5
# A longer pause, ns, is a camera that was stopped.
_STOPPED_NS = 30_000_000_000


class ImageLoss:
    """
    Compares images with their camera_info and with the frame rate.

    A camera publishes both with the same stamp, so that a stamp without an image is a lost image.
    Where no stamp agrees, the driver stamps them differently and only the frame rate is compared.

    not_received : images that were not received although their camera_info was
    not_taken : images missing by the frame rate: neither they nor their camera_info was received
    """

    def __init__(self) -> None:
        self.not_received = 0
        self.not_taken = 0
        self._agree = False
        # stamp -> whether the image was received, of those that are not evaluated yet
        self._images: dict[int, bool] = {}
        self._order: list[int] = []
        self._last_image_ns = 0
        self._previous_ns: int | None = None
        self._spacings: deque[int] = deque(maxlen=_SPACINGS)
        self._infos: set[int] = set()

    @property
    def total(self) -> int:
        """Number of images that are known to be lost."""
        return self.not_received + self.not_taken

    def add_info(self, stamp_ns: int) -> None:
        """Add the stamp of a camera_info, nanoseconds."""
        self._add(stamp_ns, is_image=False)

    def add_image(self, stamp_ns: int) -> None:
        """Add the stamp of an image, nanoseconds."""
        self._add(stamp_ns, is_image=True)

    def finish(self) -> None:
        """Evaluate all stamps; no others follow."""
        self._evaluate(len(self._order))

    def _add(self, stamp_ns: int, *, is_image: bool) -> None:
        if self._previous_ns is not None and stamp_ns <= self._previous_ns:
            # evaluated already, or a clock that was set back
            if self._previous_ns - stamp_ns > _LATE_NS:
                self._restart()
            else:
                return
        if stamp_ns not in self._images:
            self._order.insert(bisect_left(self._order, stamp_ns), stamp_ns)
            self._images[stamp_ns] = False
        if is_image:
            self._images[stamp_ns] = True
            self._last_image_ns = max(self._last_image_ns, stamp_ns)
        else:
            self._infos.add(stamp_ns)
        self._agree |= self._images[stamp_ns] and stamp_ns in self._infos
        self._evaluate(bisect_left(self._order, self._end_of_evaluation_ns()))

    def _end_of_evaluation_ns(self) -> int:
        # Images are large and wait in queues while their camera_info overtakes them: only a later
        # image tells that one is lost, or a long silence of the image topic.
        return max(self._last_image_ns - _LATE_NS, self._order[-1] - _STOPPED_NS)

    def _restart(self) -> None:
        self._images.clear()
        self._infos.clear()
        self._order.clear()
        self._spacings.clear()
        self._previous_ns = None
        self._last_image_ns = 0

    def _evaluate(self, count: int) -> None:
        for stamp_ns in list(islice(self._order, count)):
            is_image = self._images.pop(stamp_ns)
            self._infos.discard(stamp_ns)
            if not self._agree and not is_image:
                # of another stamp than its image, which is counted by itself
                continue
            self.not_received += not is_image
            self._evaluate_spacing(stamp_ns)
        del self._order[:count]

    def _evaluate_spacing(self, stamp_ns: int) -> None:
        previous_ns, self._previous_ns = self._previous_ns, stamp_ns
        if previous_ns is None:
            return
        spacing_ns = stamp_ns - previous_ns
        if spacing_ns > _STOPPED_NS:
            self._spacings.clear()
            return
        if len(self._spacings) >= _MIN_SPACINGS:
            period_ns = median(self._spacings)
            if spacing_ns > _MISSING_PERIODS * period_ns:
                self.not_taken += round(spacing_ns / period_ns) - 1
        self._spacings.append(spacing_ns)
