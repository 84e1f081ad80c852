# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Protocol of a camera: images with the time of exposure, and exposure settings."""

from dataclasses import dataclass
from typing import Protocol

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.model import Image
from ivfmc_ros.validation import require_in_range

# Seconds between the images of a camera that rests: often enough to see that it is lost.
REST_PERIOD = 0.5


@dataclass(frozen=True, eq=False, kw_only=True)
class CameraImage:
    """
    An image as the camera delivers it.

    image : (height, width) mono or (height, width, 3) BGR, uint8 or uint16
    stamp_ns : start of exposure, nanoseconds since the epoch
    """

    image: Image
    stamp_ns: int


@dataclass(frozen=True, kw_only=True)
class Exposure:
    """
    Exposure settings of a camera.

    frame_rate : images per second that the camera is asked for
    seconds : exposure time of each image
    gain : amplification, 1 is the camera's own sensitivity
    triggered : each exposure is started by a pulse on the camera's trigger line; false: by the
        camera itself, at ``frame_rate``

    :raises ParameterError: a value is out of range, or the exposure is longer than the period
    """

    frame_rate: float = 15.0
    seconds: float = 0.005
    gain: float = 1.0
    triggered: bool = False

    def __post_init__(self) -> None:
        require_in_range('frame_rate', self.frame_rate, 0.1, 1000.0, 'Hz')
        require_in_range('exposure', self.seconds, 1e-6, 1.0, 's')
        if self.seconds * self.frame_rate > 1.0:
            raise ParameterError(
                f'exposure: {self.seconds} s is longer than the period of frame_rate: '
                f'{self.frame_rate} Hz'
            )
        require_in_range('gain', self.gain, 0.0, 100.0, open_low=True)


class CameraDevice(Protocol):
    """
    A camera. One thread opens it, grabs and closes it.

    warning : which settings the camera did not take, '' if it took all; measuring with automatic
        exposure, gain or white balance is guessing
    """

    warning: str

    def open(self) -> None:
        """
        Connect to the camera and begin to acquire.

        :raises CameraLostError: the camera cannot be opened
        """

    def grab(self, timeout: float) -> CameraImage | None:
        """
        Return the next image, None if there is none within ``timeout`` seconds.

        :raises CameraLostError: the camera delivers no images any more
        """

    def set_exposure(self, exposure: Exposure) -> None:
        """Apply the settings to the following images; may be called from any thread."""

    def rest(self, resting: bool) -> None:
        """
        Give an image each ``REST_PERIOD`` only while ``resting``, because nothing takes them.

        Called in the thread that grabs. A camera that saves nothing by it may go on as before.
        """

    def close(self) -> None:
        """Release the camera; raises nothing."""
