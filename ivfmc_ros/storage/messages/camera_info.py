# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Converts a sensor_msgs/CameraInfo to a ``Camera``."""

from typing import Any

import numpy as np

from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.cell.camera import complete_distortion
from ivfmc_ros.errors import CellError


def to_camera(info: Any, where: str = 'camera_info') -> Camera:
    """
    Return the camera of a sensor_msgs/CameraInfo.

    The camera is that of the image: the region of interest and the binning are applied to K.

    where : file and topic, for the error
    :raises CellError: the message has no valid calibration, as that of an uncalibrated camera
    """
    model = info.distortion_model or 'plumb_bob'
    binning = max(int(info.binning_x), 1), max(int(info.binning_y), 1)
    x, y, width, height = _region(info, where)
    K = np.asarray(info.k, dtype=np.float64).reshape(3, 3).copy()
    # REP 104: K is that of the full resolution; the image is cropped first and binned then
    K[0, 2] -= x
    K[1, 2] -= y
    K[0] /= binning[0]
    K[1] /= binning[1]
    is_full = (x, y) == (0, 0) and binning == (1, 1)
    try:
        return Camera(
            width=width // binning[0],
            height=height // binning[1],
            K=K,
            distortion=complete_distortion(model, info.d),
            model=model,
        )
    except CellError as error:
        cause = '' if is_full else 'with roi and binning applied, '
        raise CellError(f'{where}: {cause}{error}') from error


def distortion_remark(info: Any) -> str:
    """Return what is said of a camera_info that states no distortion, '' where it states one."""
    if len(info.d):
        return ''
    return 'states no distortion (d is empty): the images are taken as free of it'


def _region(info: Any, where: str) -> tuple[int, int, int, int]:
    """Return (x, y, width, height) of the image in that of full resolution, pixels."""
    roi = info.roi
    x, y, width, height = (int(v) for v in (roi.x_offset, roi.y_offset, roi.width, roi.height))
    if not (width or height):
        # zeros stand for the full resolution
        if x or y:
            raise CellError(f'{where}: roi: has an offset ({x}, {y}), but no width and height')
        return 0, 0, int(info.width), int(info.height)
    if not (width and height and x + width <= info.width and y + height <= info.height):
        raise CellError(
            f'{where}: roi: {width} x {height} at ({x}, {y}) does not lie in the full resolution, '
            f'width and height, of {info.width} x {info.height}'
        )
    return x, y, width, height
