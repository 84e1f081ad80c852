# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Camera that plays the image files of a folder at the frame rate."""

from pathlib import Path
import time

from ivfmc_ros import pictures
from ivfmc_ros.devices.cameras.device import CameraImage
from ivfmc_ros.devices.cameras.device import Exposure
from ivfmc_ros.devices.cameras.frame_timer import FrameTimer
from ivfmc_ros.errors import CameraLostError
from ivfmc_ros.errors import FileError


class FolderCamera:
    """
    A CameraDevice that delivers the images of a folder in natural order of their names.

    repeat : begin again after the last image; otherwise there are no more
    """

    def __init__(self, folder: Path, exposure: Exposure, *, repeat: bool = True) -> None:
        self._folder, self._exposure, self._repeat = folder, exposure, repeat
        self._timer = FrameTimer()
        self.warning = ''
        self._files: list[Path] = []
        self._delivered = 0

    def open(self) -> None:
        """
        List the images of the folder.

        :raises CameraLostError: there is no such folder, or no image in it
        """
        try:
            self._files = pictures.list_pictures(self._folder)
        except FileError as error:
            raise CameraLostError(str(error)) from error
        self._delivered = 0

    def grab(self, timeout: float) -> CameraImage | None:
        """
        Return the next image, None if there is none within ``timeout`` seconds.

        :raises CameraLostError: an image cannot be read
        """
        if self._delivered >= len(self._files) and not self._repeat:
            time.sleep(timeout)
            return None
        if self._timer.wait_next(1 / self._exposure.frame_rate, timeout) is None:
            return None
        stamp_ns = time.time_ns()
        path = self._files[self._delivered % len(self._files)]
        self._delivered += 1
        try:
            return CameraImage(image=pictures.read_picture(path), stamp_ns=stamp_ns)
        except FileError as error:
            raise CameraLostError(str(error)) from error

    def set_exposure(self, exposure: Exposure) -> None:
        """Apply the frame rate; exposure time and gain have no effect on files."""
        self._exposure = exposure

    def rest(self, resting: bool) -> None:
        """Go on: an image that is left out would be missing."""

    def close(self) -> None:
        """Forget the list of images."""
        self._files = []
