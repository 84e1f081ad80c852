# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Image arrays to sensor_msgs/Image or CompressedImage, and back."""

from array import array
from typing import Any

import cv2
import numpy as np
from sensor_msgs.msg import CompressedImage
from sensor_msgs.msg import Image as ImageMessage

from ivfmc_ros.errors import MessageError
from ivfmc_ros.errors import ScanError
from ivfmc_ros.model import Image
from ivfmc_ros.nodes.convert.stamps import header
from ivfmc_ros.storage.messages.image_decoding import decode_compressed
from ivfmc_ros.storage.messages.image_decoding import decode_image

CAMERA_FRAME = 'camera_optical_frame'

# (array dimensions, bytes per pixel) -> encoding of sensor_msgs/Image
_ENCODINGS = {(2, 1): 'mono8', (2, 2): 'mono16', (3, 3): 'bgr8', (3, 6): 'bgr16'}


def to_image(image: Image, stamp_ns: int, frame_id: str = CAMERA_FRAME) -> ImageMessage:
    """Return a (height, width) mono or (height, width, 3) BGR image as a message."""
    height, width = image.shape[:2]
    pixel = image.itemsize * (image.shape[2] if image.ndim == 3 else 1)
    ordered = np.ascontiguousarray(image, dtype=image.dtype.newbyteorder('<'))
    return ImageMessage(
        header=header(stamp_ns, frame_id),
        height=height,
        width=width,
        encoding=_ENCODINGS[image.ndim, pixel],
        is_bigendian=0,
        step=width * pixel,
        data=octets(ordered),
    )


def from_image(message: Any, where: str) -> Image:
    """
    Return a sensor_msgs/Image or CompressedImage as (height, width) mono or (h, w, 3) BGR.

    where : topic, named in the error
    :raises MessageError: encoding or size is invalid, or the data cannot be decoded
    """
    decode = decode_compressed if isinstance(message, CompressedImage) else decode_image
    try:
        return decode(message, where)
    except ScanError as error:
        raise MessageError(str(error)) from error


def to_jpeg(image: Image, stamp_ns: int, frame_id: str = CAMERA_FRAME) -> CompressedImage:
    """Return an 8-bit image, mono or BGR, as a JPEG (quality 80) message."""
    done, data = cv2.imencode('.jpg', image, [cv2.IMWRITE_JPEG_QUALITY, 80])
    if not done:
        raise MessageError(f'an image of shape {image.shape} cannot be encoded as JPEG')
    return CompressedImage(header=header(stamp_ns, frame_id), format='jpeg', data=octets(data))


def octets(values: Any) -> 'array[int]':
    """Return the bytes of a contiguous array as ``array('B')``, which rclpy copies as a whole."""
    data = array('B')
    data.frombytes(memoryview(values).cast('B'))
    return data
