# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The ``camera_info`` YAML of camera_calibration, which every ROS camera driver loads."""

from pathlib import Path

import numpy as np
import yaml

from ivfmc_ros import files
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.cell.camera import DISTORTION_COEFFICIENTS
from ivfmc_ros.cell.fields import Fields
from ivfmc_ros.errors import CellError
from ivfmc_ros.model import Floats


def load_camera(path: Path) -> Camera:
    """
    Read a camera calibration file.

    :raises CellError: names the file and the key that is missing or impossible
    """
    fields = Fields.read(path)
    model = fields.text('distortion_model')
    if model not in DISTORTION_COEFFICIENTS:
        known = ', '.join(DISTORTION_COEFFICIENTS)
        raise fields.fail('distortion_model', f'{model!r} is not one of {known}')
    matrix = fields.mapping('camera_matrix').array('data', 9).reshape(3, 3)
    distortion = fields.mapping('distortion_coefficients')
    try:
        return Camera(
            width=fields.count('image_width'),
            height=fields.count('image_height'),
            K=matrix,
            distortion=distortion.array('data', DISTORTION_COEFFICIENTS[model]),
            model=model,
            # a serial number is a name, though YAML makes a number of it
            name=str(fields.get('camera_name')) if fields.has('camera_name') else 'camera',
        )
    except CellError as error:
        text = str(error)
        raise error if text.startswith(str(path)) else CellError(f'{path}: {text}') from None


def save_camera(path: Path, camera: Camera) -> None:
    """
    Write a camera calibration file.

    :raises FileError: it cannot be written
    """
    projection = np.hstack([camera.K, np.zeros((3, 1))])
    document = {
        'image_width': camera.width,
        'image_height': camera.height,
        'camera_name': camera.name,
        'camera_matrix': _matrix(camera.K),
        'distortion_model': camera.model,
        'distortion_coefficients': _matrix(camera.distortion.reshape(1, -1)),
        'rectification_matrix': _matrix(np.eye(3)),
        'projection_matrix': _matrix(projection),
    }
    files.write_text(path, yaml.safe_dump(document, sort_keys=False, default_flow_style=None))


def _matrix(values: Floats) -> dict[str, object]:
    rows, columns = values.shape
    return {'rows': rows, 'cols': columns, 'data': values.ravel().tolist()}
