# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Converts a sensor_msgs/CameraInfo to a ``Camera``."""

from typing import Any

import numpy as np

from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.cell.camera import DISTORTION_COEFFICIENTS
from ivfmc_ros.errors import CellError


def to_camera(info: Any, where: str = 'camera_info') -> Camera:
    """
    Return the camera of a sensor_msgs/CameraInfo.

    where : file and topic, for the error
    :raises CellError: the message has no valid calibration, as that of an uncalibrated camera
    """
    model = info.distortion_model or 'plumb_bob'
    distortion = np.asarray(info.d, dtype=np.float64)
    if not distortion.any():
        # a camera without distortion may omit the coefficients
        distortion = np.zeros(DISTORTION_COEFFICIENTS.get(model, 0))
    try:
        return Camera(
            width=int(info.width),
            height=int(info.height),
            K=np.asarray(info.k, dtype=np.float64).reshape(3, 3),
            distortion=distortion,
            model=model,
        )
    except CellError as error:
        raise CellError(f'{where}: {error}') from error
