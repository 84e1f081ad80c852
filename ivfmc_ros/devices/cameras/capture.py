# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A camera that is kept running by a thread of its own."""

from collections.abc import Callable
import threading

from ivfmc_ros.devices.cameras.device import CameraDevice
from ivfmc_ros.devices.cameras.device import Exposure
from ivfmc_ros.devices.cameras.device import Picture
from ivfmc_ros.errors import DeviceError

_RETRY = 1.0  # seconds from one attempt to open the camera to the next
_WAIT = 0.2  # seconds; the thread sees as often that it shall end
_SILENCE = 3.0  # seconds without a picture, beyond the period, after which the camera is lost


class Capture:
    """
    Delivers pictures as they come, and opens the camera again when it was lost.

    deliver : called in the thread with each picture
    """

    def __init__(
        self, camera: CameraDevice, exposure: Exposure, deliver: Callable[[Picture], None]
    ) -> None:
        self._camera, self._exposure, self._deliver = camera, exposure, deliver
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None
        self.trouble = 'the camera is not open yet'
        self.pictures = 0

    def start(self) -> None:
        """Open the camera in the background, and deliver."""
        self._closing.clear()
        self._thread = threading.Thread(target=self._run, name='capture', daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Deliver no more, and let the camera go; may be called again."""
        self._closing.set()
        thread, self._thread = self._thread, None
        if thread is not None:
            thread.join()

    def set_exposure(self, exposure: Exposure) -> None:
        """Take the following pictures so."""
        self._exposure = exposure
        self._camera.set_exposure(exposure)

    def _run(self) -> None:
        while not self._closing.is_set():
            try:
                self._camera.open()
                self._grab()
            except Exception as error:  # whatever it is, pictures must not end in silence
                known = isinstance(error, DeviceError)
                self.trouble = str(error) if known else f'{type(error).__name__}: {error}'
                self._closing.wait(_RETRY)
            finally:
                self._camera.close()

    def _grab(self) -> None:
        quiet = 0.0
        while not self._closing.is_set():
            picture = self._camera.grab(_WAIT)
            if picture is None:
                quiet += _WAIT
                if quiet > _SILENCE + 1 / self._exposure.frame_rate:
                    self.trouble = 'the camera gives no pictures'
                continue
            quiet, self.trouble = 0.0, ''
            self.pictures += 1
            self._deliver(picture)
