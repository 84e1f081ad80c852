# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Camera behind OpenCV's VideoCapture: USB cameras, video files, network streams."""

import math
from pathlib import Path
import time
from typing import Any

import cv2
import numpy as np

from ivfmc_ros.devices.cameras.device import CameraImage
from ivfmc_ros.devices.cameras.device import Exposure
from ivfmc_ros.devices.cameras.device import REST_PERIOD
from ivfmc_ros.errors import CameraLostError

_MAX_FAILURES = 5  # consecutive reads without an image; one or two are usual after opening
_SYSFS = Path('/sys/class/video4linux')
_MANUAL_EXPOSURE = 1  # value of V4L2_CID_EXPOSURE_AUTO for exposure by hand
_EXPOSURE_UNIT = 1e-4  # seconds, unit of V4L2_CID_EXPOSURE_ABSOLUTE
_READ_BACK_TOLERANCE = 0.05  # relative; cameras round exposure and gain to steps of their own
_FAILURE_PAUSE = 0.05  # seconds after a failed read, so that a lost camera causes no busy loop


class OpencvCamera:
    """
    A CameraDevice that reads from cv2.VideoCapture.

    device : number, path or URL
    size : (width, height) in pixels to ask for, None for the camera's own
    latency : seconds from the end of exposure until the driver delivers the image; OpenCV does
        not report when an image was taken, so measure it once and set it here
    mono : convert to grayscale, which is what the stripe detection works on
    pixel_format : four characters such as GREY, YUYV or MJPG to ask for, '' for the camera's own
    white_balance : color temperature in kelvin to fix; 0 to switch the automatic off only

    Size and format that the camera does not take are errors; exposure, gain and white balance that
    it does not take are a warning. A camera that is opened again has to have the same serial
    number.
    """

    def __init__(
        self,
        device: str,
        exposure: Exposure,
        *,
        size: tuple[int, int] | None = None,
        latency: float = 0.0,
        mono: bool = True,
        pixel_format: str = '',
        white_balance: int = 0,
    ) -> None:
        self._device, self._exposure = device, exposure
        self._size, self._latency, self._mono = size, latency, mono
        self._pixel_format, self._white_balance = pixel_format, white_balance
        self._serial: str | None = None
        self.warning = ''
        self._capture: Any = None
        self._exposure_changed = False
        self._failures = 0
        self._is_resting, self._retrieved_at = False, -math.inf

    def open(self) -> None:
        """
        Open the device and apply size and exposure.

        :raises CameraLostError: there is no such camera, or it is another one than before, or it
            does not have the size or format
        """
        source = int(self._device) if self._device.isdecimal() else self._device
        self._require_same_camera()
        self._capture = cv2.VideoCapture(source)
        if not self._capture.isOpened():
            self.close()
            raise CameraLostError(
                f'camera {self._device}: cannot be opened; check number, path or URL, and that no '
                'other process uses it'
            )
        self._apply_format()
        # an image that waited in a queue would get a stamp that is too late
        self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        self._apply_exposure()
        # of a camera that was opened: while none is plugged in, it has no serial number
        self._serial = serial_number(self._device)
        self._failures = 0

    def grab(self, timeout: float) -> CameraImage | None:
        """
        Return the next image, None if this read failed, or it was left out while resting.

        timeout : seconds, longest pause after a failed read
        :raises CameraLostError: several reads in a row failed
        """
        if self._capture is None:
            raise CameraLostError(f'camera {self._device}: is not open')
        if self._exposure_changed:
            self._apply_exposure()
        grabbed = self._capture.grab()
        now = time.monotonic()
        if grabbed and self._is_resting and now - self._retrieved_at < REST_PERIOD:
            # taken from the driver, so that none waits there, but not decoded
            return None
        self._retrieved_at = now
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

    def rest(self, resting: bool) -> None:
        """Decode an image each ``REST_PERIOD`` only while ``resting``."""
        self._is_resting = resting

    def close(self) -> None:
        """Release the device."""
        capture, self._capture = self._capture, None
        if capture is not None:
            capture.release()

    def _require_same_camera(self) -> None:
        serial = serial_number(self._device)
        if self._serial is not None and serial != self._serial:
            raise CameraLostError(
                f'camera {self._device}: is another camera now (serial number {serial or "none"}, '
                f'it was {self._serial or "none"}); its calibration does not hold'
            )

    def _apply_format(self) -> None:
        """:raises CameraLostError: the camera has another size or format than the one asked for"""
        if self._pixel_format:
            self._capture.set(
                cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*self._pixel_format.ljust(4))
            )
            code = int(self._capture.get(cv2.CAP_PROP_FOURCC))
            found = code.to_bytes(4, 'little', signed=code < 0).decode('ascii', 'replace').strip()
            if found != self._pixel_format:
                self.close()
                raise CameraLostError(
                    f'camera {self._device}: pixel_format: {self._pixel_format} was asked for, '
                    f'the camera gives {found}'
                )
        if self._size is not None:
            self._capture.set(cv2.CAP_PROP_FRAME_WIDTH, self._size[0])
            self._capture.set(cv2.CAP_PROP_FRAME_HEIGHT, self._size[1])
            keys = (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
            width, height = (int(self._capture.get(key)) for key in keys)
            if (width, height) != self._size:
                self.close()
                raise CameraLostError(
                    f'camera {self._device}: {self._size[0]}x{self._size[1]} pixels were asked '
                    f'for, the camera gives {width}x{height}'
                )

    def _apply_exposure(self) -> None:
        """Switch automatic modes off, set exposure, gain and white balance, and compare."""
        self._exposure_changed = False
        wanted = {
            'frame_rate': (cv2.CAP_PROP_FPS, self._exposure.frame_rate),
            'automatic exposure': (cv2.CAP_PROP_AUTO_EXPOSURE, float(_MANUAL_EXPOSURE)),
            'exposure': (
                cv2.CAP_PROP_EXPOSURE,
                float(round(self._exposure.seconds / _EXPOSURE_UNIT)),
            ),
            'gain': (cv2.CAP_PROP_GAIN, self._exposure.gain),
            'automatic white balance': (cv2.CAP_PROP_AUTO_WB, 0.0),
        }
        if self._white_balance:
            temperature = float(self._white_balance)
            wanted['white balance'] = (cv2.CAP_PROP_WB_TEMPERATURE, temperature)
        refused = []
        for name, (key, value) in wanted.items():
            self._capture.set(key, value)
            found = self._capture.get(key)
            if abs(found - value) > _READ_BACK_TOLERANCE * abs(value):
                refused.append(f'{name} {value:g} was asked for, the camera has {found:g}')
        # files and streams have no settings at all
        self.warning = '; '.join(refused) if self._is_local else ''

    @property
    def _is_local(self) -> bool:
        return self._device.isdecimal() or self._device.startswith('/dev/')


def serial_number(device: str) -> str:
    """Return the serial number of a USB camera by its number or path, '' if it has none."""
    path = Path(f'/dev/video{device}' if device.isdecimal() else device)
    node = _SYSFS / path.resolve().name / 'device'
    # of the USB interface; the number is that of the USB device above it
    for folder in (node, node / '..'):
        try:
            return (folder / 'serial').read_text(encoding='utf-8').strip()
        except OSError:
            continue
    return ''
