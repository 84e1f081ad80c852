# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reading and writing of camera calibration YAML, the format of ROS camera_calibration."""

from pathlib import Path

import numpy as np
import yaml

from ivfmc_ros import files
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.cell.camera import complete_distortion
from ivfmc_ros.cell.fields import YamlMapping
from ivfmc_ros.errors import CellError
from ivfmc_ros.file_kinds import CAMERA
from ivfmc_ros.file_kinds import require_kind
from ivfmc_ros.model import Floats


def load_camera(path: Path) -> Camera:
    """
    Read a camera calibration file.

    :raises CellError: a key is missing or has an impossible value; names the file and the key
    """
    fields = YamlMapping.read(path)
    require_kind(path, fields.values, CAMERA)
    if fields.has('fisheye_model') and fields.required('fisheye_model'):
        raise fields.error('fisheye_model', 'must be 0; only pinhole cameras can be read')
    matrix = fields.mapping('camera_matrix').array('data', 9).reshape(3, 3)
    given = fields.mapping('distortion_coefficients').numbers('data')
    # OpenCV's own files have no model; it follows from the number of coefficients
    opencv_model = 'plumb_bob' if len(given) <= 5 else 'rational_polynomial'
    is_opencv = fields.is_opencv and not fields.has('distortion_model')
    model = opencv_model if is_opencv else fields.text('distortion_model')
    try:
        return Camera(
            width=fields.positive_integer('image_width'),
            height=fields.positive_integer('image_height'),
            K=matrix,
            distortion=complete_distortion(model, given),
            model=model,
            # YAML parses a serial number to an integer
            name=str(fields.required('camera_name')) if fields.has('camera_name') else 'camera',
            covariance=_read_covariance(fields),
        )
    except CellError as error:
        text = str(error)
        raise error if text.startswith(str(path)) else CellError(f'{path}: {text}') from None


def _read_covariance(fields: YamlMapping) -> Floats | None:
    """Return the covariance of the intrinsics; other programs do not write the key."""
    if not fields.has('covariance'):
        return None
    matrix = fields.mapping('covariance')
    rows = matrix.positive_integer('rows')
    return matrix.array('data', rows * rows).reshape(rows, rows)


def save_camera(path: Path, camera: Camera) -> None:
    """
    Write a camera calibration file.

    :raises FileError: the file cannot be written
    """
    projection = np.hstack([camera.K, np.zeros((3, 1))])
    document: dict[str, object] = {
        'image_width': camera.width,
        'image_height': camera.height,
        'camera_name': camera.name,
        'camera_matrix': _matrix(camera.K),
        'distortion_model': camera.model,
        'distortion_coefficients': _matrix(camera.distortion.reshape(1, -1)),
        'rectification_matrix': _matrix(np.eye(3)),
        'projection_matrix': _matrix(projection),
    }
    if camera.covariance is not None:
        # drivers skip keys that they do not know
        document['covariance'] = _matrix(camera.covariance)
    files.write_text(path, yaml.safe_dump(document, sort_keys=False, default_flow_style=None))


def _matrix(values: Floats) -> dict[str, object]:
    rows, columns = values.shape
    return {'rows': rows, 'cols': columns, 'data': values.ravel().tolist()}
