# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Camera behind OpenCV's VideoCapture: USB cameras, video files, network streams."""

import time
from typing import Any

import cv2
import numpy as np

from ivfmc_ros.devices.cameras.device import CameraImage
from ivfmc_ros.devices.cameras.device import Exposure
from ivfmc_ros.errors import CameraLostError

_MAX_FAILURES = 5  # consecutive reads without an image; one or two are usual after opening
_MANUAL_EXPOSURE = 1  # value of V4L2_CID_EXPOSURE_AUTO for exposure by hand
_EXPOSURE_UNIT = 1e-4  # seconds, unit of V4L2_CID_EXPOSURE_ABSOLUTE
_FAILURE_PAUSE = 0.05  # seconds after a failed read, so that a lost camera causes no busy loop


class OpencvCamera:
    """
    A CameraDevice that reads from cv2.VideoCapture.

    device : number, path or URL
    size : (width, height) in pixels to ask for, None for the camera's own
    latency : seconds from the end of exposure until the driver delivers the image; OpenCV does
        not report when an image was taken, so measure it once and set it here
    mono : convert to grayscale, which is what the stripe detection works on
    """

    def __init__(
        self,
        device: str,
        exposure: Exposure,
        *,
        size: tuple[int, int] | None = None,
        latency: float = 0.0,
        mono: bool = True,
    ) -> None:
        self._device, self._exposure = device, exposure
        self._size, self._latency, self._mono = size, latency, mono
        self._capture: Any = None
        self._exposure_changed = False
        self._failures = 0

    def open(self) -> None:
        """
        Open the device and apply size and exposure.

        :raises CameraLostError: there is no such camera
        """
        source = int(self._device) if self._device.isdecimal() else self._device
        self._capture = cv2.VideoCapture(source)
        if not self._capture.isOpened():
            self.close()
            raise CameraLostError(
                f'camera {self._device}: cannot be opened; check number, path or URL, and that no '
                'other process uses it'
            )
        if self._size is not None:
            self._capture.set(cv2.CAP_PROP_FRAME_WIDTH, self._size[0])
            self._capture.set(cv2.CAP_PROP_FRAME_HEIGHT, self._size[1])
        # an image that waited in a queue would get a stamp that is too late
        self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        self._apply_exposure()
        self._failures = 0

    def grab(self, timeout: float) -> CameraImage | None:
        """
        Return the next image, None if this read failed.

        timeout : seconds, longest pause after a failed read
        :raises CameraLostError: several reads in a row failed
        """
        if self._capture is None:
            raise CameraLostError(f'camera {self._device}: is not open')
        if self._exposure_changed:
            self._apply_exposure()
        grabbed = self._capture.grab()
        age = self._latency + self._exposure.seconds
        stamp_ns = time.time_ns() - round(age * 1e9)
        retrieved, image = self._capture.retrieve() if grabbed else (False, None)
        if not retrieved or image is None:
            self._failures += 1
            if self._failures >= _MAX_FAILURES:
                raise CameraLostError(f'camera {self._device}: delivers no images any more')
            time.sleep(min(timeout, _FAILURE_PAUSE))
            return None
        self._failures = 0
        if self._mono and image.ndim == 3:
            image = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        return CameraImage(image=np.ascontiguousarray(image), stamp_ns=stamp_ns)

    def set_exposure(self, exposure: Exposure) -> None:
        """Apply the settings to the following images, as far as the camera's driver can."""
        self._exposure, self._exposure_changed = exposure, True

    def close(self) -> None:
        """Release the device."""
        capture, self._capture = self._capture, None
        if capture is not None:
            capture.release()

    def _apply_exposure(self) -> None:
        self._exposure_changed = False
        self._capture.set(cv2.CAP_PROP_FPS, self._exposure.frame_rate)
        self._capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, _MANUAL_EXPOSURE)
        self._capture.set(cv2.CAP_PROP_EXPOSURE, round(self._exposure.seconds / _EXPOSURE_UNIT))
        self._capture.set(cv2.CAP_PROP_GAIN, self._exposure.gain)
