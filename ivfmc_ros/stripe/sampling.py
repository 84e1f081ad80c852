# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Acquisition of a stream of pictures, the first of which decide how all are measured."""

from ivfmc_ros.model import Frame
from ivfmc_ros.model import Profile
from ivfmc_ros.stripe.acquisition import Acquisition

# From so many pictures it is decided what the settings leave to the data.
SAMPLED_PICTURES = 16

Measured = list[tuple[Frame, Profile]]


class SampledAcquisition:
    """
    Makes the profiles of a scan as its pictures come, live and from a bag alike.

    The first pictures wait until there are enough of them to decide by. A profile is rounded as
    a message rounds it, so that a live scan decides nothing else later on.
    """

    def __init__(self, acquisition: Acquisition, sampled: int = SAMPLED_PICTURES) -> None:
        self.acquisition = acquisition
        self._sampled = sampled
        self._first: list[Frame] | None = []

    @property
    def waiting(self) -> int:
        """How many pictures wait for more to decide by."""
        return len(self._first or ())

    def add(self, frame: Frame) -> Measured:
        """
        Return what can be measured now, oldest first.

        :raises CellError: a picture has another size than the calibration, or another laser
        :raises GeometryError: the table angle of a picture is not known
        """
        if self._first is None:
            return [(frame, self._measure(frame))]
        self.acquisition.require_usable(frame)
        self._first.append(frame)
        return self.flush() if len(self._first) >= self._sampled else []

    def flush(self) -> Measured:
        """Decide by the pictures that came, and return their profiles."""
        first, self._first = self._first, None
        if not first:
            self._first = first
            return []
        self.acquisition.prepare(first)
        return [(frame, self._measure(frame)) for frame in first]

    def _measure(self, frame: Frame) -> Profile:
        return self.acquisition.profile(frame).to_single_precision()
