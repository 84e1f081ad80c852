# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Executable ``camera``: images of a camera device, each with its calibration.

Publishes image_raw and camera_info with the stamp of the start of exposure. Backends: OpenCV
(USB, network), Aravis (GenICam), a folder of image files, the simulated cell.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.lifecycle import LifecycleState
from sensor_msgs.msg import CameraInfo
from sensor_msgs.msg import Image
from sensor_msgs.msg import RegionOfInterest
from sensor_msgs.srv import SetCameraInfo

from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.cell.camera_file import load_camera
from ivfmc_ros.cell.camera_file import save_camera
from ivfmc_ros.devices.cameras.aravis import AravisCamera
from ivfmc_ros.devices.cameras.aravis import AravisSettings
from ivfmc_ros.devices.cameras.capture import Capture
from ivfmc_ros.devices.cameras.device import CameraDevice
from ivfmc_ros.devices.cameras.device import CameraImage
from ivfmc_ros.devices.cameras.device import Exposure
from ivfmc_ros.devices.cameras.folder import FolderCamera
from ivfmc_ros.devices.cameras.opencv import OpencvCamera
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.errors import ScanError
from ivfmc_ros.nodes.convert.images import to_image
from ivfmc_ros.nodes.convert.stamps import header
from ivfmc_ros.nodes.framework.base import run
from ivfmc_ros.nodes.framework.health import Level
from ivfmc_ros.nodes.framework.health import WAITING
from ivfmc_ros.nodes.framework.json_response import describe
from ivfmc_ros.nodes.framework.lifecycle import LifecycleCellNode
from ivfmc_ros.storage.messages.camera_info import to_camera

# The parameter that locates the camera, by backend.
_LOCATIONS = {'simulated': 'simulation', 'opencv': 'device', 'folder': 'folder', 'aravis': ''}
# Backends that can expose on a trigger line.
_TRIGGERED = ('simulated', 'aravis')
# The parameters of an exposure.
_EXPOSURE = ('frame_rate', 'exposure', 'gain', 'trigger', 'triggered')


class CameraNode(LifecycleCellNode):
    """Publishes the images of a Capture, which grabs them in a thread of its own."""

    def __init__(self) -> None:
        super().__init__('camera')
        self._capture: Capture | None = None
        self._calibration: Camera | None = None
        # fault of a capture that has not tried to open its device yet
        self._not_opened = ''
        # why the calibration does not fit the images, '' when it does
        self._mismatch = ''
        self._declare_parameters()
        self.check(_require_exposure)
        self.fix_while_active('latency', 'width', 'height', 'mono', 'repeat', 'region')
        self.changed(self._apply)
        self._images = self.publish_on(Image, 'image_raw')
        self._infos = self.publish_on(CameraInfo, 'camera_info')
        self.create_service(SetCameraInfo, '~/set_camera_info', self._set_camera_info)
        self._reported_fault = ''

    def on_configure(self, state: LifecycleState) -> None:
        """Load the calibration, and check the parameters of the backend."""
        path = self.get('camera_info')
        self._calibration = load_camera(Path(path).expanduser()) if path else None
        self._device()

    def on_activate(self, state: LifecycleState) -> Any:
        """Open the camera in the background."""
        self._mismatch = ''
        self._capture = Capture(
            self._device(),
            self._exposure(),
            self._publish,
            # images of a folder may well be equal
            watched=self.get('backend') != 'folder',
            wanted=self._has_subscriptions,
        )
        self._not_opened = self._capture.fault
        self._capture.start()
        return super().on_activate(state)

    def release_device(self) -> None:
        """Close the camera before the publishers go."""
        capture, self._capture = self._capture, None
        if capture is not None:
            capture.stop()

    def before_diagnosis(self) -> None:
        """Publish the number of images, and the faults of device and calibration."""
        capture, fault = self._capture, self._fault()
        self._reported_fault = fault
        self._report_device(capture)
        if self._mismatch:
            self.health.fault('camera_info', 'size differs', self._mismatch)
        else:
            self.health.clear_fault('camera_info')
        if capture is None:
            self.status('not active')
        else:
            activity = '' if capture.fault else 'publishing images'
            self.status(activity, pictures=capture.image_count, fault=fault, **capture.counts)

    def on_beat(self) -> None:
        """Publish a new fault: a scan has to end at once, the next diagnostics are later."""
        if self._fault() != self._reported_fault:
            self.publish_diagnostics()

    def _fault(self) -> str:
        """Return why the images cannot be measured, '' if they can; the orchestrator reads it."""
        fault = '' if self._capture is None else self._capture.fault
        return '' if fault == self._not_opened else fault or self._mismatch

    def _report_device(self, capture: Capture | None) -> None:
        fault = '' if capture is None else capture.fault
        if fault and fault == self._not_opened:
            self.health.set(
                WAITING, 'camera', self.waiting_level(), 'opening the device', 'device is open'
            )
            return
        self.health.clear(WAITING, 'camera')
        if fault:
            self.health.fault('camera', 'DEVICE', fault)
        else:
            self.health.clear_fault('camera')
        warning = '' if capture is None else capture.warning
        if warning:
            self.health.fault('camera settings', 'not taken', warning, Level.WARN)
        else:
            self.health.clear_fault('camera settings')

    def _declare_parameters(self) -> None:
        declare = self.parameter
        backends = tuple(_LOCATIONS)
        declare('backend', 'opencv', 'Source of the images.', choices=backends, read_only=True)
        declare('simulation', '', 'simulated: folder of the live cell.', read_only=True)
        device = 'opencv: number, path or URL of the camera; aravis: its id, 0: the first one.'
        declare('device', '0', device, read_only=True, kind=int)
        latency = (
            'Seconds from exposure to delivery (opencv), or to the stamp of the device (aravis).'
        )
        declare('latency', 0.0, latency, low=0.0, high=1.0)
        declare('width', 0, 'opencv: pixels to request; 0: unchanged.', low=0, high=20000)
        declare('height', 0, 'opencv: pixels to request; 0: unchanged.', low=0, high=20000)
        declare('mono', True, 'opencv: convert color images to mono.')
        pixel_format = (
            'opencv: four characters such as GREY, YUYV, MJPG to request; empty: unchanged.'
        )
        declare('pixel_format', '', pixel_format, read_only=True)
        white_balance = 'opencv: kelvin to fix; 0: switch the automatic white balance off only.'
        declare('white_balance', 0, white_balance, low=0, high=20000, read_only=True)
        self._declare_aravis()
        declare('folder', '', 'folder: path of the folder of images.', read_only=True)
        declare('repeat', True, 'folder: start over after the last image.')
        declare('frame_rate', 15.0, 'Images per second.', low=0.1, high=1000.0)
        declare('exposure', 0.005, 'Exposure time, seconds.', low=1e-6, high=1.0)
        declare('gain', 1.0, 'Gain in the unit of the device.', low=0.0, high=100.0)
        declare('camera_info', '', 'Calibration file; set_camera_info writes it.', read_only=True)
        declare('frame_id', 'camera_optical_frame', 'Frame of the images.', read_only=True)

    def _declare_aravis(self) -> None:
        region = 'aravis: x, y, width, height in pixels of the sensor; empty: all of it.'
        self.parameter('region', [], region, kind=int)
        binning = 'aravis: sensor pixels that make one pixel, in both directions.'
        self.parameter('binning', 1, binning, low=1, high=8, read_only=True)
        packet_size = 'aravis: bytes of a GigE packet; 0: the greatest that passes.'
        self.parameter('packet_size', 0, packet_size, low=0, high=16000, read_only=True)
        trigger = (
            'aravis: line that starts each exposure, such as Line1; simulated: any name, for the '
            'trigger line of the table; empty: free-running.'
        )
        self.parameter('trigger', '', trigger, read_only=True)
        triggered = (
            'Whether exposures are started by the line trigger now; false: free-running. A scan '
            'with a trigger_step sets it to true for its sweeps, and to false afterwards.'
        )
        self.parameter('triggered', True, triggered)

    def _exposure(self) -> Exposure:
        return _exposure({name: self.get(name) for name in _EXPOSURE})

    def _device(self) -> CameraDevice:
        backend = self.get('backend')
        if self.get('trigger') and backend not in _TRIGGERED:
            raise ParameterError(
                f'trigger: the backend {backend} has no trigger line, only {", ".join(_TRIGGERED)}'
            )
        if backend == 'aravis':
            return AravisCamera(self._aravis_settings(), self._exposure())
        location = str(self.get(_LOCATIONS[backend]))
        if not location:
            raise ParameterError(f'{_LOCATIONS[backend]}: is required by the backend {backend}')
        if backend == 'simulated':
            # imported here: the only use of the simulation in a node
            from ivfmc_ros.simulation.live.camera import SimulatedCamera

            return SimulatedCamera(Path(location).expanduser(), self._exposure())
        if backend == 'folder':
            path = Path(location).expanduser()
            return FolderCamera(path, self._exposure(), repeat=self.get('repeat'))
        size = (self.get('width'), self.get('height'))
        return OpencvCamera(
            location,
            self._exposure(),
            size=size if all(size) else None,
            latency=self.get('latency'),
            mono=self.get('mono'),
            pixel_format=self.get('pixel_format'),
            white_balance=self.get('white_balance'),
        )

    def _region(self, divisor: int) -> tuple[int, int, int, int]:
        x, y, width, height = (int(value) // divisor for value in self.get('region'))
        return x, y, width, height

    def _aravis_settings(self) -> AravisSettings:
        region = [int(value) for value in self.get('region')]
        if len(region) not in (0, 4):
            raise ParameterError(f'region: {region}: needs x, y, width, height, or nothing')
        device = str(self.get('device'))
        return AravisSettings(
            # 0, the default, is the first camera for OpenCV as well
            device='' if device == '0' else device,
            pixel_format=self.get('pixel_format') or AravisSettings.pixel_format,
            # the camera counts pixels after binning
            region=self._region(self.get('binning')) if region else None,
            binning=self.get('binning'),
            packet_size=self.get('packet_size'),
            trigger=self.get('trigger'),
            latency=self.get('latency'),
        )

    def _apply(self, names: set[str]) -> None:
        if self._capture is not None and names & set(_EXPOSURE):
            self._capture.set_exposure(self._exposure())

    def _has_subscriptions(self) -> bool:
        publishers = (self._images, self._infos)
        return any(publisher.get_subscription_count() for publisher in publishers)

    def _publish(self, picture: CameraImage) -> None:
        frame_id = self.get('frame_id')
        # a message of 1.3 MB is made only for a subscriber
        if self._images.get_subscription_count():
            self._images.publish(to_image(picture.image, picture.stamp_ns, frame_id))
        height, width = picture.image.shape[:2]
        calibration = self._calibration
        region = self._region(1) if self.get('region') else None
        if calibration is not None and region is None:
            try:
                calibration.require_image_size(picture.image.shape, 'camera_info')
            except ScanError as error:
                # not published: a wrong calibration is worse than none
                self._mismatch = str(error)
                return
        self._mismatch = ''
        if not self._infos.get_subscription_count():
            return
        info = camera_info(calibration, width, height)
        if calibration is not None and region is not None:
            info = with_region(info, calibration, region, self.get('binning'))
        info.header = header(picture.stamp_ns, frame_id)
        self._infos.publish(info)

    def _set_camera_info(self, request: Any, response: Any) -> Any:
        try:
            path = self.get('camera_info')
            if not path:
                raise ParameterError(
                    'camera_info: is empty; set it to the file that stores the calibration'
                )
            camera = to_camera(request.camera_info, 'set_camera_info')
            save_camera(Path(path).expanduser(), camera)
            self._calibration = camera
            response.success, response.status_message = True, f'written to {path}'
        except Exception as error:  # the client gets it
            self.get_logger().error(f'set_camera_info: {describe(error)}')
            response.success, response.status_message = False, describe(error)
        return response


def camera_info(camera: Camera | None, width: int, height: int) -> CameraInfo:
    """Return the camera_info of unrectified images; zeros for an uncalibrated camera."""
    if camera is None:
        return CameraInfo(width=width, height=height)
    projection = np.hstack([camera.K, np.zeros((3, 1))])
    return CameraInfo(
        width=width,
        height=height,
        distortion_model=camera.model,
        d=camera.distortion.tolist(),
        k=camera.K.ravel().tolist(),
        r=np.eye(3).ravel().tolist(),
        p=projection.ravel().tolist(),
    )


def with_region(
    info: CameraInfo, sensor: Camera, region: tuple[int, int, int, int], binning: int
) -> CameraInfo:
    """Return the camera_info of a part of the sensor, whose calibration is that of the whole."""
    x, y, width, height = region
    info.width, info.height = sensor.width, sensor.height
    info.binning_x = info.binning_y = binning
    info.roi = RegionOfInterest(x_offset=x, y_offset=y, width=width, height=height)
    return info


def _require_exposure(values: Mapping[str, Any]) -> None:
    """:raises ParameterError: exposure time, gain or frame rate are invalid."""
    _exposure(values)


def _exposure(values: Any) -> Exposure:
    return Exposure(
        frame_rate=values['frame_rate'],
        seconds=values['exposure'],
        gain=values['gain'],
        triggered=bool(values['trigger']) and values['triggered'],
    )


def main() -> int:
    """Run the node."""
    return run(CameraNode)


if __name__ == '__main__':
    raise SystemExit(main())
