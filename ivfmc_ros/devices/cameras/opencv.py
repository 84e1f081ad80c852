# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras that OpenCV can open: USB cameras, video files, network streams."""

import time
from typing import Any

import cv2
import numpy as np

from ivfmc_ros.devices.cameras.device import Exposure
from ivfmc_ros.devices.cameras.device import Picture
from ivfmc_ros.errors import CameraLostError

_FAILURES = 5  # reads in a row without a picture
_MANUAL = 1  # what Video4Linux calls exposure by hand
_TICK = 1e-4  # seconds, in which Video4Linux counts exposure


class OpencvCamera:
    """
    A CameraDevice behind cv2.VideoCapture.

    device : number, path or URL
    size : (width, height) to ask for, None for the camera's own
    latency : seconds from the end of exposure until the driver hands the picture out; OpenCV
        does not say when a picture was taken, so that this is measured once and set
    mono : give the mean of the colours, as a laser stripe is looked at
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
        self._changed = False
        self._failures = 0

    def open(self) -> None:
        """:raises CameraLostError: there is no such camera."""
        source = int(self._device) if self._device.isdecimal() else self._device
        self._capture = cv2.VideoCapture(source)
        if not self._capture.isOpened():
            self.close()
            raise CameraLostError(f'camera {self._device}: cannot be opened')
        if self._size is not None:
            self._capture.set(cv2.CAP_PROP_FRAME_WIDTH, self._size[0])
            self._capture.set(cv2.CAP_PROP_FRAME_HEIGHT, self._size[1])
        # a picture that waited in a queue would get a stamp that is too late
        self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        self._apply()
        self._failures = 0

    def grab(self, seconds: float) -> Picture | None:
        """:raises CameraLostError: the camera gives no pictures any more."""
        if self._capture is None:
            raise CameraLostError(f'camera {self._device}: is not open')
        if self._changed:
            self._apply()
        grabbed = self._capture.grab()
        age = self._latency + self._exposure.seconds
        stamp_ns = time.time_ns() - round(age * 1e9)
        done, image = self._capture.retrieve() if grabbed else (False, None)
        if not done or image is None:
            self._failures += 1
            if self._failures >= _FAILURES:
                raise CameraLostError(f'camera {self._device}: gives no pictures any more')
            time.sleep(min(seconds, 0.05))
            return None
        self._failures = 0
        if self._mono and image.ndim == 3:
            image = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        return Picture(image=np.ascontiguousarray(image), stamp_ns=stamp_ns)

    def set_exposure(self, exposure: Exposure) -> None:
        """Take the following pictures so, as far as the camera's driver can."""
        self._exposure, self._changed = exposure, True

    def close(self) -> None:
        """Let the camera go."""
        capture, self._capture = self._capture, None
        if capture is not None:
            capture.release()

    def _apply(self) -> None:
        self._changed = False
        self._capture.set(cv2.CAP_PROP_FPS, self._exposure.frame_rate)
        self._capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, _MANUAL)
        self._capture.set(cv2.CAP_PROP_EXPOSURE, round(self._exposure.seconds / _TICK))
        self._capture.set(cv2.CAP_PROP_GAIN, self._exposure.gain)
