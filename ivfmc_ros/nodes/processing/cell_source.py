# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where a node has its cell from: cell.yaml, and the camera's calibration from camera_info."""

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
from ivfmc_ros.storage.messages.camera_info import camera_of


class CellSource:
    """
    Keeps the cell of a node up to date.

    Parameters: ``cell`` (file), ``camera`` (file; empty for the topic camera_info). What is
    missing or wrong is the condition 'cell' or 'camera_info' of the node.
    """

    def __init__(self, node: CellNode) -> None:
        self._node = node
        self._draft: CellDraft | None = None
        self._camera: Camera | None = None
        self._cell: Cell | None = None
        self._seen: Any = None
        self._read_at: tuple[int, ...] = ()
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
        self._infos = AdaptiveSubscription(node, CameraInfo, 'camera_info', self._take)

    @property
    def draft(self) -> CellDraft | None:
        """What cell.yaml says, whether or not there is a camera."""
        return self._draft

    @property
    def complete(self) -> bool:
        """Whether there are a cell.yaml and a camera."""
        return self._draft is not None and self._camera is not None

    def cell(self) -> Cell:
        """
        Return the cell.

        :raises NotReadyError: no cell.yaml is named, or no camera_info has come
        :raises CellError: cell.yaml or camera_info is wrong, or they do not go together
        """
        if self._cell is None:
            path = self._node.get('cell')
            draft = self._draft or load_draft(_named(path))
            if self._camera is None:
                topic = self._infos.topic
                raise NotReadyError(
                    f'camera_info: none has come on {topic}; start the camera, or name its '
                    'calibration by camera'
                )
            self._cell = draft.complete(self._camera, path)
        return self._cell

    def reload(self) -> None:
        """Read the files again if they were written in the meantime."""
        if self._written() != self._read_at:
            self._load_cell()
            self._load_camera()

    def _written(self) -> tuple[int, ...]:
        named = [Path(path) for path in (self._node.get('cell'), self._node.get('camera')) if path]
        return tuple(path.stat().st_mtime_ns if path.exists() else 0 for path in named)

    def _check(self, values: Mapping[str, Any]) -> None:
        """Refuse files that cannot be used, before they are."""
        if values['cell'] and values['cell'] != self._node.get('cell'):
            load_draft(Path(values['cell']))
        if values['camera'] and values['camera'] != self._node.get('camera'):
            load_camera(Path(values['camera']))

    def _change(self, names: set[str]) -> None:
        if 'cell' in names:
            self._load_cell()
        if 'camera' in names:
            self._load_camera()

    def _load_cell(self) -> None:
        self._cell = None
        self._read_at = self._written()
        try:
            self._draft = load_draft(_named(self._node.get('cell')))
        except ScanError as error:
            self._draft = None
            self._node.trouble('cell', error)
        else:
            self._node.health.clear('cell')

    def _load_camera(self) -> None:
        path = self._node.get('camera')
        self._read_at = self._written()
        if not path:
            return
        try:
            self._camera = load_camera(Path(path))
            self._cell = None
        except ScanError as error:
            self._node.trouble('camera', error)
        else:
            self._node.health.clear('camera')

    def _take(self, message: CameraInfo) -> None:
        if self._node.get('camera'):
            return
        seen = (
            message.width,
            message.height,
            message.distortion_model,
            tuple(message.k),
            tuple(message.d),
        )
        if seen == self._seen and self._camera is not None:
            return
        self._seen = seen
        self._cell = self._camera = None
        self._camera = camera_of(message, self._infos.topic)


def _named(path: str) -> Path:
    if not path:
        raise NotReadyError('cell: no file is named; set the parameter cell to a cell.yaml')
    return Path(path)
