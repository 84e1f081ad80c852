# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Builds sensor_msgs messages from arrays and ``Camera``; ``cdr.encode`` makes bytes of them."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Image
from ivfmc_ros.storage.messages import cdr

IMAGE = 'sensor_msgs/msg/Image'
COMPRESSED_IMAGE = 'sensor_msgs/msg/CompressedImage'
CAMERA_INFO = 'sensor_msgs/msg/CameraInfo'
JOINT_STATE = 'sensor_msgs/msg/JointState'
POINT_CLOUD = 'sensor_msgs/msg/PointCloud2'
TF_MESSAGE = 'tf2_msgs/msg/TFMessage'

CAMERA_FRAME = 'camera_optical_frame'

# (array dimensions, bytes per pixel) -> encoding
_ENCODINGS = {(2, 1): 'mono8', (2, 2): 'mono16', (3, 3): 'bgr8', (3, 6): 'bgr16'}


def image(stamp_ns: int, image: Image) -> Any:
    """
    Return a sensor_msgs/Image.

    image : (height, width) mono or (height, width, 3) BGR, uint8 or uint16
    """
    height, width = image.shape[:2]
    pixel = image.itemsize * (image.shape[2] if image.ndim == 3 else 1)
    ordered = np.ascontiguousarray(image, dtype=image.dtype.newbyteorder('<'))
    return cdr.message(
        IMAGE,
        header=cdr.header(stamp_ns, CAMERA_FRAME),
        height=height,
        width=width,
        encoding=_ENCODINGS[image.ndim, pixel],
        is_bigendian=0,
        step=width * pixel,
        data=ordered.reshape(-1).view(np.uint8),
    )


def compressed_image(stamp_ns: int, data: bytes, format: str) -> Any:
    """Return a sensor_msgs/CompressedImage with the bytes of a 'jpeg' or 'png' file."""
    return cdr.message(
        COMPRESSED_IMAGE,
        header=cdr.header(stamp_ns, CAMERA_FRAME),
        format=format,
        data=np.frombuffer(data, dtype=np.uint8),
    )


def camera_info(stamp_ns: int, camera: Camera) -> Any:
    """Return the sensor_msgs/CameraInfo of a camera whose images are not rectified."""
    return cdr.message(
        CAMERA_INFO,
        header=cdr.header(stamp_ns, CAMERA_FRAME),
        height=camera.height,
        width=camera.width,
        distortion_model=camera.model,
        d=_flat(camera.distortion),
        k=_flat(camera.K),
        r=_flat(np.eye(3)),
        p=_flat(np.hstack([camera.K, np.zeros((3, 1))])),
        binning_x=0,
        binning_y=0,
        roi=cdr.message(
            'sensor_msgs/msg/RegionOfInterest',
            x_offset=0,
            y_offset=0,
            height=0,
            width=0,
            do_rectify=False,
        ),
    )


def joint_state(
    stamp_ns: int, positions: Mapping[str, float], velocity: float | None = None
) -> Any:
    """
    Return a sensor_msgs/JointState.

    positions : radians by joint; or 1.0 (on) and 0.0 (off) by laser
    velocity : radians per second, of every joint; None leaves the field empty
    """
    return cdr.message(
        JOINT_STATE,
        header=cdr.header(stamp_ns, ''),
        name=list(positions),
        position=_flat(list(positions.values())),
        velocity=_flat([] if velocity is None else [velocity] * len(positions)),
        effort=_flat([]),
    )


def _flat(values: Floats | list[float]) -> Floats:
    return np.ascontiguousarray(values, dtype=np.float64).reshape(-1)
