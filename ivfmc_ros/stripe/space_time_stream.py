# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Acquisition of a stream of images with space-time analysis over the images of a sweep."""

from dataclasses import dataclass
from dataclasses import field

from ivfmc_ros.errors import GeometryError
from ivfmc_ros.model import Frame
from ivfmc_ros.stripe.acquisition import Acquisition
from ivfmc_ros.stripe.stream import FrameProfiles
from ivfmc_ros.stripe.stream import StreamAcquisition
from ivfmc_ros.stripe.stream import TUNING_IMAGES


@dataclass(eq=False)
class _Sweep:
    """The last frames of a sweep; those before ``ready`` have a profile."""

    frames: list[Frame] = field(default_factory=list)
    ready: int = 0


class SpaceTimeAcquisition:
    """
    Computes the profiles of a scan with dense angle steps by space-time analysis.

    A profile needs ``settings.space_time`` images before and after its own in the same sweep, so
    that it is returned with that delay. Sweeps of several lasers may alternate.
    """

    def __init__(self, acquisition: Acquisition, sampled: int = TUNING_IMAGES) -> None:
        self.acquisition = acquisition
        self._half = acquisition.settings.space_time
        self._sampled = sampled
        self._buffered: list[Frame] | None = []
        self._sweeps: dict[int, _Sweep] = {}

    def add(self, frame: Frame) -> FrameProfiles:
        """
        Add a frame; return the profiles that are complete.

        :raises CellError: the size of the image differs from the calibration, or unknown laser
        :raises GeometryError: the table angle of the image is not finite
        :raises ParameterError: the images do not have ``image_bits``, or look like fewer bits
        """
        frame = self.acquisition.prepare(frame)
        if self._buffered is None:
            return self._process(frame)
        self._buffered.append(frame)
        return self._process_buffered() if len(self._buffered) >= self._sampled else []

    def flush(self) -> FrameProfiles:
        """
        Return the profiles of all remaining frames.

        :raises GeometryError: no point of the scan was seen in enough images
        """
        measured = self._process_buffered()
        for laser in list(self._sweeps):
            measured += self._end(laser)
        counts = self.acquisition.counts
        if counts.stripe_points and counts.unconfirmed == counts.stripe_points:
            raise GeometryError(
                f'space_time: none of {counts.stripe_points} stripe points is seen in enough '
                'images; scan with smaller angle steps, or set space_time to 0'
            )
        return measured

    def _process_buffered(self) -> FrameProfiles:
        buffered, self._buffered = self._buffered, None
        if not buffered:
            return []
        self.acquisition.resolve_auto_settings(buffered)
        return [pair for frame in buffered for pair in self._process(frame)]

    def _process(self, frame: Frame) -> FrameProfiles:
        sweep = self._sweeps.get(frame.laser)
        ended = sweep is not None and sweep.frames[-1].view != frame.view
        measured = self._end(frame.laser) if ended else []
        sweep = self._sweeps.setdefault(frame.laser, _Sweep())
        sweep.frames.append(frame)
        while sweep.ready + self._half < len(sweep.frames):
            measured += self._next(sweep)
        return measured

    def _end(self, laser: int) -> FrameProfiles:
        sweep = self._sweeps.pop(laser)
        return [pair for _ in sweep.frames[sweep.ready :] for pair in self._next(sweep)]

    def _next(self, sweep: _Sweep) -> FrameProfiles:
        """Compute the profile of the next frame, and drop the frame that no later one needs."""
        index = sweep.ready
        frame = sweep.frames[index]
        around = sweep.frames[: index + self._half + 1]
        profile = self.acquisition.profile(frame, around=around).to_single_precision()
        if index < self._half:
            sweep.ready += 1
        else:
            del sweep.frames[0]
        return [(frame, profile)]


def create_stream(acquisition: Acquisition) -> StreamAcquisition | SpaceTimeAcquisition:
    """Return the acquisition of a whole scan that the setting ``space_time`` selects."""
    if acquisition.settings.space_time:
        return SpaceTimeAcquisition(acquisition)
    return StreamAcquisition(acquisition)
