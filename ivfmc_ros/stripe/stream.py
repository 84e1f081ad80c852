# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Acquisition of a stream of images; automatic settings are resolved from the buffered ones."""

from collections.abc import Callable

from ivfmc_ros.model import Frame
from ivfmc_ros.model import Profile
from ivfmc_ros.stripe.acquisition import Acquisition

# Images from which automatic settings are resolved.
TUNING_IMAGES = 16

FrameProfiles = list[tuple[Frame, Profile]]


class StreamAcquisition:
    """
    Computes the profiles of a scan image by image, live or from a bag.

    The buffered images are buffered until there are enough of them to resolve automatic settings.
    Profiles are rounded to single precision, as in messages, so that live and offline
    reconstruction give equal results.
    """

    def __init__(
        self,
        acquisition: Acquisition,
        sampled: int = TUNING_IMAGES,
        on_progress: Callable[[], object] = lambda: None,
    ) -> None:
        """
        Start without images.

        sampled : number of images from which automatic settings are resolved
        on_progress : called after each image, so that a node shows that it is alive
        """
        self.acquisition = acquisition
        self._on_progress = on_progress
        self._sampled = sampled
        self._buffered: list[Frame] | None = []

    @property
    def waiting(self) -> int:
        """Number of buffered images."""
        return len(self._buffered or ())

    def add(self, frame: Frame) -> FrameProfiles:
        """
        Add a frame; return the profiles that are complete, oldest buffered.

        :raises CellError: the size of the image differs from the calibration, or unknown laser
        :raises GeometryError: the table angle of the image is not finite
        :raises ParameterError: the images do not have ``image_bits``, or look like fewer bits
        """
        frame = self.acquisition.prepare(frame)
        if self._buffered is None:
            return [(frame, self._measure(frame))]
        self._buffered.append(frame)
        return self.flush() if len(self._buffered) >= self._sampled else []

    def flush(self) -> FrameProfiles:
        """Resolve automatic settings from the buffered images, and return their profiles."""
        buffered, self._buffered = self._buffered, []
        if not buffered:
            self._buffered = buffered
            return []
        # images that are refused do not determine the settings of those that follow
        self.acquisition.resolve_auto_settings(buffered, self._on_progress)
        self._buffered = None
        return [(frame, self._measure(frame)) for frame in buffered]

    def _measure(self, frame: Frame) -> Profile:
        profile = self.acquisition.profile(frame).to_single_precision()
        self._on_progress()
        return profile
