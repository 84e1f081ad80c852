# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
GenICam cameras (GigE Vision, USB3 Vision) through Aravis.

Aravis has no wheel: it is a library of the system with introspection (on Debian and Ubuntu:
``gir1.2-aravis-0.8`` and ``python3-gi``), which Python has to see.
"""

from dataclasses import dataclass
import importlib
import threading
import time
from typing import Any

import numpy as np

from ivfmc_ros.devices.cameras.clock_fit import ClockFit
from ivfmc_ros.devices.cameras.device import CameraImage
from ivfmc_ros.devices.cameras.device import Exposure
from ivfmc_ros.errors import CameraLostError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.model import Image

_BUFFERS = 8  # images that wait for this process
_READ_BACK_TOLERANCE = 0.05  # relative; cameras round exposure and gain to steps of their own
_MICROSECONDS = 1e6
# Bytes a pixel, by the pixel formats that are read.
_FORMATS = {'Mono8': np.uint8, 'Mono16': np.uint16}


@dataclass(frozen=True, kw_only=True)
class AravisSettings:
    """
    What a GenICam camera is set to.

    device : id as ``arv-tool-0.8`` lists it; '' for the first camera
    pixel_format : Mono8 or Mono16
    region : (x, y, width, height) in pixels of the sensor, None for the whole sensor
    binning : sensor pixels that make one pixel, in both directions
    packet_size : bytes of a GigE packet; 0 for the greatest that passes
    trigger : line that starts each exposure while ``Exposure.triggered``, such as Line1; '' for a
        free-running camera
    latency : seconds from the start of the exposure to the camera's timestamp

    :raises ParameterError: the pixel format is another one
    """

    device: str = ''
    pixel_format: str = 'Mono8'
    region: tuple[int, int, int, int] | None = None
    binning: int = 1
    packet_size: int = 0
    trigger: str = ''
    latency: float = 0.0

    def __post_init__(self) -> None:
        if self.pixel_format not in _FORMATS:
            raise ParameterError(
                f'pixel_format: {self.pixel_format!r} is none of {", ".join(_FORMATS)}'
            )


class AravisCamera:
    """
    A CameraDevice with Aravis.

    Region, binning and pixel format that the camera does not take are errors; exposure, gain and
    frame rate are a warning. A camera that is opened again has to have the same serial number.
    """

    def __init__(self, settings: AravisSettings, exposure: Exposure) -> None:
        self._settings, self._exposure = settings, exposure
        self._library: Any = None
        self._camera: Any = None
        self._stream: Any = None
        self._serial: str | None = None
        self._clock = ClockFit()
        self._exposure_changed = False
        self._is_triggered = False
        # of the present connection; set by a thread of Aravis
        self._is_lost = threading.Event()
        self.warning = ''

    def open(self) -> None:
        """
        Connect, apply the settings, and begin to acquire.

        :raises CameraLostError: Aravis is not installed, there is no such camera, it is another
            one than before, or it does not take region, binning or pixel format
        """
        self._library = load_aravis()
        name = self._settings.device or 'the first camera'
        try:
            # on a computer with several networks, a GigE camera that is opened without it may
            # send its images to an address of another one
            self._library.update_device_list()
            self._camera = self._library.Camera.new(self._settings.device or None)
        except Exception as error:  # of GLib, which has no class that could be named here
            raise CameraLostError(f'camera {name}: cannot be opened: {error}') from error
        try:
            self._require_same_camera()
            self._apply_format()
            self._apply_exposure()
            self._start()
        except CameraLostError:
            self.close()
            raise
        except Exception as error:  # of GLib, see above
            self.close()
            raise CameraLostError(f'camera {name}: {error}') from error

    def grab(self, timeout: float) -> CameraImage | None:
        """
        Return the next image, None if there is none, or an incomplete one, within ``timeout``.

        timeout : seconds
        :raises CameraLostError: the connection to the camera is lost
        """
        if self._stream is None:
            raise CameraLostError('camera: is not open')
        if self._is_lost.is_set():
            raise CameraLostError('camera: does not answer any more; is it unplugged?')
        if self._exposure_changed:
            self._apply_exposure()
            self._switch_trigger()
        buffer = self._stream.timeout_pop_buffer(round(timeout * _MICROSECONDS))
        if buffer is None:
            return None
        arrived_ns, now_ns = time.monotonic_ns(), time.time_ns()
        try:
            if buffer.get_status() != self._library.BufferStatus.SUCCESS:
                return None
            image = self._image(buffer)
            taken_ns = self._clock.to_steady(buffer.get_timestamp(), arrived_ns)
        finally:
            self._stream.push_buffer(buffer)
        age_ns = arrived_ns - taken_ns + round(self._settings.latency * 1e9)
        return CameraImage(image=image, stamp_ns=now_ns - age_ns)

    def set_exposure(self, exposure: Exposure) -> None:
        """Apply the settings to the following images."""
        self._exposure, self._exposure_changed = exposure, True

    def rest(self, resting: bool) -> None:
        """Go on: the camera sends its images in any case."""

    def close(self) -> None:
        """Release the camera."""
        camera, self._camera, self._stream = self._camera, None, None
        # one that is gone is not waited for: each request to it takes seconds
        if camera is not None and not self._is_lost.is_set():
            try:
                camera.stop_acquisition()
            except Exception:  # of GLib: the camera is gone, which is what close is for
                return

    # -- steps

    def _require_same_camera(self) -> None:
        serial = str(self._camera.get_device_serial_number())
        if self._serial is None:
            self._serial = serial
        elif serial != self._serial:
            raise CameraLostError(
                f'camera: is another one now (serial number {serial}, it was {self._serial}); its '
                'calibration does not hold'
            )

    def _apply_format(self) -> None:
        """:raises CameraLostError: the camera does not take format, region or binning"""
        settings, camera = self._settings, self._camera
        camera.set_pixel_format_from_string(settings.pixel_format)
        if settings.binning > 1:
            camera.set_binning(settings.binning, settings.binning)
            found = tuple(camera.get_binning())
            if found != (settings.binning,) * 2:
                raise CameraLostError(
                    f'camera: binning {settings.binning} was asked for, it has {found}'
                )
        if settings.region is not None:
            camera.set_region(*settings.region)
            region = camera.get_region()
            found = tuple(int(value) for value in region)
            if found != settings.region:
                raise CameraLostError(
                    f'camera: region {settings.region} was asked for, it has {found}; offsets and '
                    'sizes are multiples of a step of the camera'
                )

    def _apply_exposure(self) -> None:
        """Switch automatic modes off, set exposure, gain and rate, and compare."""
        self._exposure_changed = False
        camera, off = self._camera, self._library.Auto.OFF
        refused = []
        for set_auto in (camera.set_exposure_time_auto, camera.set_gain_auto):
            try:
                set_auto(off)
            except Exception as error:  # of GLib: the camera has no automatic mode, as a rule
                refused.append(f'{set_auto.__name__}: {error}')
        microseconds, rate = self._exposure.seconds * _MICROSECONDS, self._exposure.frame_rate
        wanted = (
            ('exposure', camera.set_exposure_time, camera.get_exposure_time, microseconds),
            ('gain', camera.set_gain, camera.get_gain, self._exposure.gain),
            ('frame_rate', camera.set_frame_rate, camera.get_frame_rate, rate),
        )
        for name, write, read, value in wanted:
            try:
                write(value)
                found = read()
            except Exception as error:  # of GLib: no such feature
                refused.append(f'{name}: {error}')
                continue
            if abs(found - value) > _READ_BACK_TOLERANCE * value:
                refused.append(f'{name} {value:g} was asked for, the camera has {found:g}')
        self.warning = '; '.join(refused)

    def _switch_trigger(self) -> None:
        """
        Begin or end to expose on the line, between two acquisitions.

        :raises CameraLostError: the camera does not take it
        """
        if self._exposure.triggered == self._is_triggered:
            return
        try:
            # GenICam cameras lock TriggerMode during an acquisition
            self._camera.stop_acquisition()
            self._apply_trigger()
            self._camera.start_acquisition()
        except Exception as error:  # of GLib, see above
            raise CameraLostError(f'camera: trigger {self._settings.trigger}: {error}') from error

    def _apply_trigger(self) -> None:
        self._is_triggered = self._exposure.triggered
        if self._is_triggered and self._settings.trigger:
            # sets TriggerSelector, TriggerMode, TriggerSource, and TriggerActivation: rising edge
            self._camera.set_trigger(self._settings.trigger)
        else:
            self._camera.clear_triggers()

    def _start(self) -> None:
        settings, camera = self._settings, self._camera
        lost = self._is_lost = threading.Event()
        camera.get_device().connect('control-lost', lambda *_: lost.set())
        self._apply_trigger()
        if camera.is_gv_device():
            if settings.packet_size:
                camera.gv_set_packet_size(settings.packet_size)
            else:
                camera.gv_auto_packet_size()
        self._clock = ClockFit()
        self._stream = camera.create_stream(None, None)
        payload = camera.get_payload()
        for _ in range(_BUFFERS):
            self._stream.push_buffer(self._library.Buffer.new_allocate(payload))
        camera.start_acquisition()

    def _image(self, buffer: Any) -> Image:
        width, height = buffer.get_image_width(), buffer.get_image_height()
        data = np.frombuffer(buffer.get_data(), dtype=_FORMATS[self._settings.pixel_format])
        return data[: width * height].reshape(height, width).copy()


def load_aravis() -> Any:
    """
    Return the library.

    :raises CameraLostError: it is not installed, or this Python does not see it
    """
    try:
        # of the system, so that neither a type checker nor pip knows them
        importlib.import_module('gi').require_version('Aravis', '0.8')
        return importlib.import_module('gi.repository.Aravis')
    except (ImportError, ValueError) as error:
        raise CameraLostError(
            f'backend aravis: {error}; install gir1.2-aravis-0.8 and python3-gi, and run with the '
            'Python of the system, or a virtual environment made with --system-site-packages'
        ) from error
