# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Faults of a USB camera that is emulated below OpenCV, and what the driver makes of them."""

from collections.abc import Callable
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
import math
from pathlib import Path
import threading
import time
from typing import Any
from unittest import mock

import cv2
import numpy as np

from ivfmc_ros.devices.cameras import opencv
from ivfmc_ros.devices.cameras.capture import Capture
from ivfmc_ros.devices.cameras.device import Exposure

_SIZE, _FORMAT, _RATE_HZ = (64, 48), 'GREY', 25.0
# Seconds until a fault is said, and until an image comes when it has ended.
_PATIENCE_S = 15.0


class EmulatedCamera:
    """
    A camera on a USB port; its attributes may be changed at any time.

    plugged : it answers
    frozen : it sends the same image again and again
    delivers : cleared: its driver waits for the next image
    size, pixel_format, exposure : that it takes instead of those that are asked for; None: these
    """

    def __init__(self, folder: Path) -> None:
        """``folder`` : stands for /sys/class/video4linux."""
        self.plugged, self.frozen = True, False
        self.delivers = threading.Event()
        self.delivers.set()
        self.size: tuple[int, int] | None = None
        self.pixel_format: str | None = None
        self.exposure: float | None = None
        self._serial = folder / 'video0' / 'device' / 'serial'
        self._serial.parent.mkdir(parents=True)
        self.plug('A1')
        self.rng = np.random.default_rng(0)
        self.image = self.rng.integers(0, 9, _SIZE[::-1]).astype(np.uint8)

    def plug(self, serial: str) -> None:
        self._serial.write_text(serial)
        self.plugged = True

    def unplug(self) -> None:
        self._serial.unlink(missing_ok=True)
        self.plugged = False


class _VideoCapture:
    """cv2.VideoCapture of an EmulatedCamera."""

    def __init__(self, camera: EmulatedCamera) -> None:
        self._camera, self._values = camera, dict[int, float]()
        self._opened = camera.plugged

    def isOpened(self) -> bool:  # noqa: N802, the name of OpenCV
        return self._opened

    def set(self, key: int, value: float) -> bool:
        self._values[key] = value
        return True

    def get(self, key: int) -> float:
        camera = self._camera
        if camera.size and key in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT):
            return float(camera.size[key == cv2.CAP_PROP_FRAME_HEIGHT])
        if camera.pixel_format and key == cv2.CAP_PROP_FOURCC:
            return float(cv2.VideoWriter.fourcc(*camera.pixel_format))
        if camera.exposure and key == cv2.CAP_PROP_EXPOSURE:
            return camera.exposure
        return self._values.get(key, 0.0)

    def grab(self) -> bool:
        # a handle of a camera that was unplugged stays dead
        self._opened = self._opened and self._camera.plugged
        if not self._opened:
            return False
        time.sleep(1.0 / _RATE_HZ)
        return self._camera.delivers.wait(10.0)

    def retrieve(self) -> tuple[bool, np.ndarray]:
        camera = self._camera
        if not camera.frozen:
            camera.image = camera.rng.integers(0, 9, _SIZE[::-1]).astype(np.uint8)
        return True, camera.image

    def release(self) -> None:
        self._opened = False


@dataclass(frozen=True, kw_only=True)
class CameraFault:
    """
    A fault, and how it ends.

    said : part of the text that names it
    is_warning : images go on, and diagnostics warn
    """

    name: str
    cause: Callable[[EmulatedCamera], object]
    end: Callable[[EmulatedCamera], object]
    said: str
    is_warning: bool = False


def _replug(serial: str = 'A1', **changes: Any) -> Callable[[EmulatedCamera], None]:
    """Return a function that plugs a camera out and in, with other properties."""

    def replug(camera: EmulatedCamera) -> None:
        camera.unplug()
        # the driver has to notice
        time.sleep(0.5)
        for name, value in changes.items():
            setattr(camera, name, value)
        camera.plug(serial)

    return replug


CAMERA_FAULTS = (
    CameraFault(
        name='camera unplugged',
        cause=EmulatedCamera.unplug,
        end=lambda camera: camera.plug('A1'),
        said='camera 0',
    ),
    CameraFault(
        name='another camera in its place',
        cause=_replug('B2'),
        end=_replug(),
        said='serial number B2, it was A1',
    ),
    CameraFault(
        name='frozen',
        cause=lambda camera: setattr(camera, 'frozen', True),
        end=lambda camera: setattr(camera, 'frozen', False),
        said='frozen',
    ),
    CameraFault(
        name='driver that waits for an image',
        cause=lambda camera: camera.delivers.clear(),
        end=lambda camera: camera.delivers.set(),
        said='delivers no images',
    ),
    CameraFault(
        name='wrong size',
        cause=_replug(size=(32, 24)),
        end=_replug(size=None),
        said='gives 32x24',
    ),
    CameraFault(
        name='wrong format',
        cause=_replug(pixel_format='YUYV'),
        end=_replug(pixel_format=None),
        said='gives YUYV',
    ),
    CameraFault(
        name='exposure refused',
        cause=_replug(exposure=156.0),
        end=_replug(exposure=None),
        said='the camera has 156',
        is_warning=True,
    ),
)


@dataclass(frozen=True)
class Found:
    """
    What came of a fault.

    said_s : seconds until it was said, NaN if it was not
    text : that said it
    images : that were delivered while it was said, in half a second
    recovered_s : seconds from its end until it was no longer said and an image came, NaN if never
    """

    said_s: float
    text: str
    images: int
    recovered_s: float


@contextmanager
def capturing(folder: Path) -> Iterator[tuple[EmulatedCamera, Capture]]:
    """Run the driver of an emulated camera; it delivers images."""
    camera = EmulatedCamera(folder)
    with (
        mock.patch.object(opencv, '_SYSFS', folder),
        mock.patch.object(cv2, 'VideoCapture', lambda source: _VideoCapture(camera)),
    ):
        exposure = Exposure(frame_rate=_RATE_HZ)
        device = opencv.OpencvCamera('0', exposure, size=_SIZE, pixel_format=_FORMAT)
        capture = Capture(device, exposure, lambda image: None)
        capture.start()
        try:
            assert math.isfinite(_seconds(lambda: capture.image_count > 0)), capture.fault
            yield camera, capture
        finally:
            camera.delivers.set()
            capture.stop()


def camera_outcome(fault: CameraFault, folder: Path) -> Found:
    """Cause a fault, and end it."""
    with capturing(folder) as (camera, capture):

        def said() -> str:
            return capture.warning if fault.is_warning else capture.fault

        begin = time.monotonic()
        fault.cause(camera)
        waited = _seconds(lambda: fault.said in said())
        said_s = time.monotonic() - begin if math.isfinite(waited) else math.nan
        text, before = said(), capture.image_count
        time.sleep(0.5)
        images = capture.image_count - before
        begin = time.monotonic()
        fault.end(camera)
        before = capture.image_count
        waited = _seconds(lambda: not said() and capture.image_count > before)
        recovered_s = time.monotonic() - begin if math.isfinite(waited) else math.nan
        return Found(said_s, text, images, recovered_s)


def _seconds(condition: Callable[[], object]) -> float:
    """Wait for a condition; return the seconds, NaN if it did not come true."""
    begin = time.monotonic()
    while not condition():
        if time.monotonic() - begin > _PATIENCE_S:
            return math.nan
        time.sleep(0.005)
    return time.monotonic() - begin
