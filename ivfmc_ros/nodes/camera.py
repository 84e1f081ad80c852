# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The node of the camera: pictures, and the calibration that goes with each."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.lifecycle import LifecycleState
from sensor_msgs.msg import CameraInfo
from sensor_msgs.msg import Image
from sensor_msgs.srv import SetCameraInfo

from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.cell.camera_file import load_camera
from ivfmc_ros.cell.camera_file import save_camera
from ivfmc_ros.devices.cameras.capture import Capture
from ivfmc_ros.devices.cameras.device import CameraDevice
from ivfmc_ros.devices.cameras.device import Exposure
from ivfmc_ros.devices.cameras.device import Picture
from ivfmc_ros.devices.cameras.folder import FolderCamera
from ivfmc_ros.devices.cameras.opencv import OpencvCamera
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.errors import ScanError
from ivfmc_ros.nodes.convert.images import to_image
from ivfmc_ros.nodes.convert.stamps import header
from ivfmc_ros.nodes.framework.base import run
from ivfmc_ros.nodes.framework.health import Level
from ivfmc_ros.nodes.framework.json_response import describe
from ivfmc_ros.nodes.framework.lifecycle import LifecycleCellNode
from ivfmc_ros.storage.messages.camera_info import camera_of

_PLACES = {'simulated': 'simulation', 'opencv': 'device', 'folder': 'folder'}


class CameraNode(LifecycleCellNode):
    """Publishes what a Capture delivers."""

    def __init__(self) -> None:
        super().__init__('camera')
        self._capture: Capture | None = None
        self._calibration: Camera | None = None
        self._mismatch = ''
        self._declare_camera()
        self.check(_require_exposure)
        self.fix_while_active('latency', 'width', 'height', 'mono', 'repeat')
        self.changed(self._apply)
        self._images = self.publish_on(Image, 'image_raw')
        self._infos = self.publish_on(CameraInfo, 'camera_info')
        self.create_service(SetCameraInfo, '~/set_camera_info', self._set_camera_info)

    def on_configure(self, state: LifecycleState) -> None:
        """Read the calibration, and check that the backend knows where its camera is."""
        path = self.get('camera_info')
        self._calibration = load_camera(Path(path).expanduser()) if path else None
        self._device()

    def on_activate(self, state: LifecycleState) -> Any:
        """Open the camera in the background."""
        self._mismatch = ''
        self._capture = Capture(self._device(), self._exposure(), self._deliver)
        self._capture.start()
        return super().on_activate(state)

    def let_go(self) -> None:
        """Close the camera before the publishers go."""
        capture, self._capture = self._capture, None
        if capture is not None:
            capture.stop()

    def before_diagnosis(self) -> None:
        """Say how many pictures there were, and what is wrong."""
        capture = self._capture
        if capture is None:
            self.status(Level.OK, 'not active')
            return
        trouble = capture.trouble or self._mismatch
        level = Level.ERROR if trouble else Level.OK
        self.status(level, trouble or 'pictures come', pictures=capture.pictures)

    def _declare_camera(self) -> None:
        say = self.parameter
        backends = tuple(_PLACES)
        say('backend', 'opencv', 'What takes the pictures.', choices=backends, read_only=True)
        say('simulation', '', 'simulated: folder of the live cell.', read_only=True)
        device = 'opencv: number, path or URL of the camera.'
        say('device', '0', device, read_only=True, kind=int)
        say('latency', 0.0, 'opencv: seconds from exposure to picture.', low=0.0, high=1.0)
        say('width', 0, 'opencv: pixels to ask for, 0 as it is.', low=0, high=20000)
        say('height', 0, 'opencv: pixels to ask for, 0 as it is.', low=0, high=20000)
        say('mono', True, 'opencv: give the brightness of coloured pictures.')
        say('folder', '', 'folder: of the pictures.', read_only=True)
        say('repeat', True, 'folder: begin again after the last picture.')
        say('frame_rate', 15.0, 'Pictures a second.', low=0.1, high=1000.0)
        say('exposure', 0.005, 'Of each picture, seconds.', low=1e-6, high=1.0)
        say('gain', 1.0, 'As the camera counts it.', low=0.0, high=100.0)
        say('camera_info', '', 'Calibration file; set_camera_info writes it.', read_only=True)
        say('frame_id', 'camera_optical_frame', 'Frame of the pictures.', read_only=True)

    def _exposure(self) -> Exposure:
        return _exposure({name: self.get(name) for name in ('frame_rate', 'exposure', 'gain')})

    def _device(self) -> CameraDevice:
        backend = self.get('backend')
        place = str(self.get(_PLACES[backend]))
        if not place:
            raise ParameterError(f'{_PLACES[backend]}: is needed for the backend {backend}')
        if backend == 'simulated':
            # the only place where the graph knows of a simulation
            from ivfmc_ros.simulation.live.camera import SimulatedCamera

            return SimulatedCamera(Path(place).expanduser(), self._exposure())
        if backend == 'folder':
            path = Path(place).expanduser()
            return FolderCamera(path, self._exposure(), repeat=self.get('repeat'))
        size = (self.get('width'), self.get('height'))
        return OpencvCamera(
            place,
            self._exposure(),
            size=size if all(size) else None,
            latency=self.get('latency'),
            mono=self.get('mono'),
        )

    def _apply(self, names: set[str]) -> None:
        if self._capture is not None and names & {'frame_rate', 'exposure', 'gain'}:
            self._capture.set_exposure(self._exposure())

    def _deliver(self, picture: Picture) -> None:
        frame_id = self.get('frame_id')
        self._images.publish(to_image(picture.image, picture.stamp_ns, frame_id))
        height, width = picture.image.shape[:2]
        calibration = self._calibration
        if calibration is not None:
            try:
                calibration.require_image(picture.image.shape, 'camera_info')
            except ScanError as error:
                # without one the listeners wait, with a wrong one they would measure
                self._mismatch = str(error)
                return
        self._mismatch = ''
        info = camera_info(calibration, width, height)
        info.header = header(picture.stamp_ns, frame_id)
        self._infos.publish(info)

    def _set_camera_info(self, request: Any, response: Any) -> Any:
        try:
            path = self.get('camera_info')
            if not path:
                raise ParameterError('camera_info: names no file to keep the calibration in')
            camera = camera_of(request.camera_info, 'set_camera_info')
            save_camera(Path(path).expanduser(), camera)
            self._calibration = camera
            response.success, response.status_message = True, f'written to {path}'
        except Exception as error:  # the caller gets to know
            self.get_logger().error(f'set_camera_info: {describe(error)}')
            response.success, response.status_message = False, describe(error)
        return response


def camera_info(camera: Camera | None, width: int, height: int) -> CameraInfo:
    """Return the calibration of pictures that are not rectified; zeros where there is none."""
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


def _require_exposure(values: Mapping[str, Any]) -> None:
    """:raises ParameterError: the values make no exposure."""
    _exposure(values)


def _exposure(values: Any) -> Exposure:
    return Exposure(
        frame_rate=values['frame_rate'], seconds=values['exposure'], gain=values['gain']
    )


def main() -> int:
    """Run the node."""
    return run(CameraNode)


if __name__ == '__main__':
    raise SystemExit(main())
