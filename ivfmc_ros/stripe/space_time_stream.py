# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Acquisition of a stream of pictures in which each point is followed through its neighbours."""

from dataclasses import dataclass
from dataclasses import field

from ivfmc_ros.errors import GeometryError
from ivfmc_ros.model import Frame
from ivfmc_ros.stripe.acquisition import Acquisition
from ivfmc_ros.stripe.sampling import Measured
from ivfmc_ros.stripe.sampling import SAMPLED_PICTURES
from ivfmc_ros.stripe.sampling import SampledAcquisition


@dataclass(eq=False)
class _Sweep:
    """The last pictures of one sweep; those before ``ready`` are measured."""

    frames: list[Frame] = field(default_factory=list)
    ready: int = 0


class FollowedAcquisition:
    """
    Makes the profiles of a scan of dense angle steps, as ``SampledAcquisition`` does of others.

    A picture waits for those after it in its sweep. Sweeps of several lasers may alternate.

    How many pictures before and after each show its points, the settings tell.
    """

    def __init__(self, acquisition: Acquisition, sampled: int = SAMPLED_PICTURES) -> None:
        self.acquisition = acquisition
        self._half = acquisition.settings.space_time
        self._sampled = sampled
        self._first: list[Frame] | None = []
        self._sweeps: dict[int, _Sweep] = {}

    def add(self, frame: Frame) -> Measured:
        """
        Return what can be measured now.

        :raises CellError: a picture has another size than the calibration, or another laser
        :raises GeometryError: the table angle of a picture is not known
        """
        self.acquisition.require_usable(frame)
        if self._first is None:
            return self._take(frame)
        self._first.append(frame)
        return self._decide() if len(self._first) >= self._sampled else []

    def flush(self) -> Measured:
        """
        Return the profiles of all pictures that still wait.

        :raises GeometryError: no point at all was seen in enough pictures
        """
        measured = self._decide()
        for laser in list(self._sweeps):
            measured += self._end(laser)
        counts = self.acquisition.counts
        if counts.stripe_points and counts.unconfirmed == counts.stripe_points:
            raise GeometryError(
                f'space_time: none of {counts.stripe_points} stripe points is seen in enough '
                'pictures; scan in finer angle steps, or take each picture by itself (0)'
            )
        return measured

    def _decide(self) -> Measured:
        first, self._first = self._first, None
        if not first:
            return []
        self.acquisition.prepare(first)
        return [pair for frame in first for pair in self._take(frame)]

    def _take(self, frame: Frame) -> Measured:
        sweep = self._sweeps.get(frame.laser)
        ended = sweep is not None and sweep.frames[-1].view != frame.view
        measured = self._end(frame.laser) if ended else []
        sweep = self._sweeps.setdefault(frame.laser, _Sweep())
        sweep.frames.append(frame)
        while sweep.ready + self._half < len(sweep.frames):
            measured += self._next(sweep)
        return measured

    def _end(self, laser: int) -> Measured:
        sweep = self._sweeps.pop(laser)
        return [pair for _ in sweep.frames[sweep.ready :] for pair in self._next(sweep)]

    def _next(self, sweep: _Sweep) -> Measured:
        """Measure one picture, and forget the one that no later picture needs."""
        index = sweep.ready
        frame = sweep.frames[index]
        around = sweep.frames[: index + self._half + 1]
        profile = self.acquisition.profile(frame, around=around).to_single_precision()
        if index < self._half:
            sweep.ready += 1
        else:
            del sweep.frames[0]
        return [(frame, profile)]


def stream_of(acquisition: Acquisition) -> SampledAcquisition | FollowedAcquisition:
    """Return what makes the profiles of a whole scan, as the settings of ``space_time`` ask."""
    if acquisition.settings.space_time:
        return FollowedAcquisition(acquisition)
    return SampledAcquisition(acquisition)
