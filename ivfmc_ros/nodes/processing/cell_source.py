# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The calibrated cell of a node: cell.yaml, and the camera from a file or from camera_info."""

from collections.abc import Callable
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sensor_msgs.msg import CameraInfo

from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.cell.camera_file import load_camera
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.cell_file import CellDraft
from ivfmc_ros.cell.cell_file import load_draft
from ivfmc_ros.errors import NotReadyError
from ivfmc_ros.errors import ScanError
from ivfmc_ros.nodes.framework.adaptive_subscription import AdaptiveSubscription
from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.storage.messages.camera_info import distortion_remark
from ivfmc_ros.storage.messages.camera_info import to_camera


class CellSource:
    """
    Declares the parameters ``cell`` and ``camera`` of a node and loads the cell from them.

    ``cell`` is a file; ``camera`` is a file, or empty for the topic camera_info. A missing or
    invalid input is a condition of the object 'cell', 'camera' or 'camera_info' of the node.
    """

    def __init__(self, node: CellNode, *, follows_images: bool = True) -> None:
        """
        Load the files, and subscribe to camera_info.

        follows_images : receive camera_info with every image. Otherwise the node receives none,
            beside an orchestrator, from when it knows the camera until ``reload``: each would
            wake it, and let the camera render for it
        """
        self._node = node
        self._follows_images = follows_images
        self._draft: CellDraft | None = None
        self._camera: Camera | None = None
        self._cell: Cell | None = None
        self._last_info: Any = None
        self._loaded_mtimes_ns: tuple[int, ...] = ()
        # called with every camera_info
        self.on_camera_info: Callable[[CameraInfo], object] = lambda _: None
        node.parameter('cell', '', 'Path of cell.yaml: lasers and turntable.')
        node.parameter(
            'camera',
            '',
            'Path of a camera_info YAML to use instead of the topic camera_info.',
        )
        node.check(self._check)
        node.changed(self._change)
        self._load_cell()
        self._load_camera()
        # public for a node that drains the queues of its other topics
        self.infos = AdaptiveSubscription(
            node, CameraInfo, 'camera_info', self._receive_camera_info
        )
        node.expect(
            'camera_info',
            lambda: self._camera is not None or node.get('camera'),
            self._missing_camera,
            f'received on {self.infos.topic}',
        )

    @property
    def draft(self) -> CellDraft | None:
        """Lasers and turntable of cell.yaml, available without a camera; None: not loaded."""
        return self._draft

    @property
    def complete(self) -> bool:
        """Whether both cell.yaml and the camera are known."""
        return self._draft is not None and self._camera is not None

    def cell(self) -> Cell:
        """
        Return the cell.

        :raises NotReadyError: the parameter cell is empty, or no camera_info was received
        :raises CellError: cell.yaml or camera_info is invalid, or they do not match
        """
        if self._cell is None:
            path = self._node.get('cell')
            draft = self._draft or load_draft(_required(path))
            if self._camera is None:
                raise NotReadyError(self._missing_camera())
            self._cell = draft.complete(self._camera, path)
        return self._cell

    def reload(self) -> None:
        """Load the files again if they have been modified, and ask for the camera again."""
        if not self._follows_images:
            self.infos.resume()
        if self._mtimes_ns() != self._loaded_mtimes_ns:
            self._load_cell()
            self._load_camera()

    def _missing_camera(self) -> str:
        return (
            f'waiting for a message on {self.infos.topic}; start the camera, or set the '
            'parameter camera to a calibration file'
        )

    def _mtimes_ns(self) -> tuple[int, ...]:
        files = [Path(path) for path in (self._node.get('cell'), self._node.get('camera')) if path]
        return tuple(path.stat().st_mtime_ns if path.exists() else 0 for path in files)

    def _check(self, values: Mapping[str, Any]) -> None:
        """Reject files that cannot be loaded."""
        if values['cell'] and values['cell'] != self._node.get('cell'):
            load_draft(Path(values['cell']))
        if values['camera'] and values['camera'] != self._node.get('camera'):
            load_camera(Path(values['camera']))

    def _change(self, names: set[str]) -> None:
        if 'cell' in names:
            self._load_cell()
        if 'camera' in names:
            self._load_camera()
            self.infos.resume()

    def _load_cell(self) -> None:
        self._cell = None
        self._loaded_mtimes_ns = self._mtimes_ns()
        try:
            self._draft = load_draft(_required(self._node.get('cell')))
        except ScanError as error:
            self._draft = None
            self._node.fault('cell', error)
        else:
            self._node.health.clear_fault('cell')

    def _load_camera(self) -> None:
        path = self._node.get('camera')
        self._loaded_mtimes_ns = self._mtimes_ns()
        if not path:
            return
        try:
            self._camera = load_camera(Path(path))
            self._cell = None
        except ScanError as error:
            self._node.fault('camera', error)
        else:
            self._node.health.clear_fault('camera')

    def _receive_camera_info(self, message: CameraInfo) -> None:
        self.on_camera_info(message)
        if not self._node.get('camera'):
            self._take(message)
        # a replay has no orchestrator, and another camera without a new scan
        if not self._follows_images and self._node.count_publishers('orchestrator/heartbeat'):
            self.infos.pause()

    def _take(self, message: CameraInfo) -> None:
        info = (
            message.width,
            message.height,
            message.distortion_model,
            tuple(message.k),
            tuple(message.d),
            (message.binning_x, message.binning_y),
            (message.roi.x_offset, message.roi.y_offset, message.roi.width, message.roi.height),
        )
        if info == self._last_info and self._camera is not None:
            return
        self._last_info = info
        self._cell = self._camera = None
        self._camera = to_camera(message, self.infos.topic)
        remark = distortion_remark(message)
        if remark:
            self._node.get_logger().warning(f'{self.infos.topic}: {remark}')


def _required(path: str) -> Path:
    if not path:
        raise NotReadyError('cell: the parameter is empty; set it to the path of a cell.yaml')
    return Path(path)
