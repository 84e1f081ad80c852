# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of a folder, as if a camera took them."""

from pathlib import Path
import time

from ivfmc_ros import pictures
from ivfmc_ros.devices.cameras.device import Exposure
from ivfmc_ros.devices.cameras.device import Picture
from ivfmc_ros.devices.motion.pacer import Pacer
from ivfmc_ros.errors import CameraLostError
from ivfmc_ros.errors import FileError


class FolderCamera:
    """
    A CameraDevice that shows the pictures of a folder in natural order.

    repeat : begin again after the last one; otherwise there are no more
    """

    def __init__(self, folder: Path, exposure: Exposure, *, repeat: bool = True) -> None:
        self._folder, self._exposure, self._repeat = folder, exposure, repeat
        self._pacer = Pacer()
        self._files: list[Path] = []
        self._shown = 0

    def open(self) -> None:
        """:raises CameraLostError: there is no such folder, or no picture in it."""
        try:
            self._files = pictures.list_pictures(self._folder)
        except FileError as error:
            raise CameraLostError(str(error)) from error
        self._shown = 0

    def grab(self, seconds: float) -> Picture | None:
        """:raises CameraLostError: a picture cannot be read."""
        if self._shown >= len(self._files) and not self._repeat:
            time.sleep(seconds)
            return None
        if self._pacer.next(1 / self._exposure.frame_rate, seconds) is None:
            return None
        stamp_ns = time.time_ns()
        path = self._files[self._shown % len(self._files)]
        self._shown += 1
        try:
            return Picture(image=pictures.read_picture(path), stamp_ns=stamp_ns)
        except FileError as error:
            raise CameraLostError(str(error)) from error

    def set_exposure(self, exposure: Exposure) -> None:
        """Only the rate matters."""
        self._exposure = exposure

    def close(self) -> None:
        """Forget the pictures."""
        self._files = []
