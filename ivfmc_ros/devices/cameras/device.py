# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a camera is to the rest of the scanner."""

from dataclasses import dataclass
from typing import Protocol

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.model import Image
from ivfmc_ros.validation import require_in_range


@dataclass(frozen=True, eq=False, kw_only=True)
class Picture:
    """
    A picture as the camera gave it.

    image : (height, width) mono or (height, width, 3) BGR, uint8 or uint16
    stamp_ns : start of exposure, nanoseconds since the epoch
    """

    image: Image
    stamp_ns: int


@dataclass(frozen=True, kw_only=True)
class Exposure:
    """
    How pictures are taken.

    frame_rate : pictures a second that are asked for
    seconds : exposure of each
    gain : 1 is the camera's own sensitivity
    """

    frame_rate: float = 15.0
    seconds: float = 0.005
    gain: float = 1.0

    def __post_init__(self) -> None:
        require_in_range('frame_rate', self.frame_rate, 0.1, 1000.0, 'Hz')
        require_in_range('exposure', self.seconds, 1e-6, 1.0, 's')
        if self.seconds * self.frame_rate > 1.0:
            raise ParameterError(
                f'exposure: {self.seconds} s is too long for {self.frame_rate} pictures a second'
            )
        require_in_range('gain', self.gain, 0.0, 100.0, open_low=True)


class CameraDevice(Protocol):
    """A camera that runs freely. One thread opens it, grabs and closes it."""

    def open(self) -> None:
        """:raises CameraLostError: there is no such camera."""

    def grab(self, seconds: float) -> Picture | None:
        """
        Return the next picture, None if there was none in so many seconds.

        :raises CameraLostError: the camera gives no pictures any more
        """

    def set_exposure(self, exposure: Exposure) -> None:
        """Take the following pictures so; from any thread."""

    def close(self) -> None:
        """Let the camera go; raises nothing."""
