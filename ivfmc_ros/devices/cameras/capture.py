# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Thread that grabs images from a camera and opens the camera again when it is lost."""

from collections.abc import Callable
from collections.abc import Mapping
import math
import threading
import time

from ivfmc_ros.devices.cameras.device import CameraDevice
from ivfmc_ros.devices.cameras.device import CameraImage
from ivfmc_ros.devices.cameras.device import Exposure
from ivfmc_ros.devices.cameras.frame_watch import FrameWatch
from ivfmc_ros.errors import CameraLostError
from ivfmc_ros.errors import DeviceError

_RETRY_PERIOD = 1.0  # seconds between attempts to open the camera
_GRAB_TIMEOUT = 0.2  # seconds; also the longest time that stop() waits for the thread
# Seconds without an image, beyond the frame period, until a fault is reported: it ends a scan some
# 2 s after the last image. The angles of a shorter pause are taken again.
_LOST_AFTER = 1.6
# Seconds without an image, beyond the frame period, after which the camera is opened again.
_REOPENED_AFTER = 6.0


class Capture:
    """
    Calls ``deliver`` in a thread of its own with each image of a camera.

    image_count : images delivered since the object was made
    """

    def __init__(
        self,
        camera: CameraDevice,
        exposure: Exposure,
        deliver: Callable[[CameraImage], None],
        *,
        watched: bool = True,
        wanted: Callable[[], bool] = lambda: True,
    ) -> None:
        """
        Make a capture that does not run.

        watched : whether equal images are a frozen camera, and one that is silent for long is
            opened again; files may well be equal, and end
        wanted : returns whether something takes the images; the camera may rest otherwise
        """
        self._camera, self._exposure, self._deliver = camera, exposure, deliver
        self._watch = FrameWatch() if watched else None
        self._wanted, self._is_resting = wanted, False
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None
        # steady second of the last image, or of the opening; None while the camera is not open
        self._last_s: float | None = None
        self._fault = 'the camera is not open yet'
        self.image_count = 0

    def start(self) -> None:
        """Start the thread, which opens the camera."""
        self._closing.clear()
        self._thread = threading.Thread(target=self._run, name='capture', daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End the thread and close the camera; may be called again."""
        self._closing.set()
        thread, self._thread = self._thread, None
        if thread is not None:
            thread.join()

    @property
    def fault(self) -> str:
        """
        Why there are no images, '' while they arrive.

        Judged by their age, because a camera that hangs may keep the thread waiting for long.
        """
        last, fault = self._last_s, self._fault
        allowed = _LOST_AFTER + 1 / self._exposure.frame_rate
        if last is not None and time.monotonic() - last > allowed:
            return 'the camera delivers no images'
        return fault

    @property
    def warning(self) -> str:
        """Which settings the camera did not take, '' if it took all."""
        return self._camera.warning

    @property
    def counts(self) -> Mapping[str, int]:
        """Images that were repeated, frozen, late or missing."""
        return {} if self._watch is None else dict(self._watch.counts)

    def set_exposure(self, exposure: Exposure) -> None:
        """Apply exposure, gain, frame rate and trigger to the following images."""
        self._exposure = exposure
        self._camera.set_exposure(exposure)

    def _run(self) -> None:
        while not self._closing.is_set():
            try:
                self._camera.open()
                self._grab_loop()
            except Exception as error:  # of the camera or of ``deliver``: report it, go on
                is_device_error = isinstance(error, DeviceError)
                self._last_s = None
                self._fault = str(error) if is_device_error else f'{type(error).__name__}: {error}'
                self._closing.wait(_RETRY_PERIOD)
            finally:
                self._camera.close()

    def _grab_loop(self) -> None:
        watch, self._last_s = self._watch, time.monotonic()
        if watch is not None:
            watch.restart()
        while not self._closing.is_set():
            self._rest_if_unwanted()
            image = self._camera.grab(_GRAB_TIMEOUT)
            now, exposure = time.monotonic(), self._exposure
            is_irregular = exposure.triggered or self._is_resting
            frame_s = 1 / exposure.frame_rate
            period = math.inf if is_irregular else frame_s
            if image is None or not (watch is None or watch.accepts(image, period, now)):
                if exposure.triggered:
                    # a table that stands triggers none, and the camera is open
                    self._last_s, self._fault = now, '' if watch is None else watch.fault
                elif watch is not None and now - (self._last_s or now) > frame_s + _REOPENED_AFTER:
                    raise CameraLostError('the camera delivers no images; it is opened again')
                continue
            self._last_s, self._fault = now, '' if watch is None else watch.fault
            self.image_count += 1
            self._deliver(image)

    def _rest_if_unwanted(self) -> None:
        is_resting = not self._exposure.triggered and not self._wanted()
        if is_resting != self._is_resting:
            self._is_resting = is_resting
            self._camera.rest(is_resting)
            if self._watch is not None:
                self._watch.expect_pause()
