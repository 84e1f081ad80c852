# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Decodes sensor_msgs/Image and CompressedImage to mono or BGR arrays."""

from dataclasses import dataclass
from typing import Any
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from ivfmc_ros.errors import BagError
from ivfmc_ros.model import Image
from ivfmc_ros.pictures import decode_picture
from ivfmc_ros.pictures import is_jpeg
from ivfmc_ros.pictures import is_png


@dataclass(frozen=True)
class _PixelLayout:
    """Channels, bits per channel, and OpenCV's conversion to BGR of an encoding."""

    channels: int = 1
    bits: int = 8
    conversion: int | None = None


# ROS names a Bayer pattern by the first row; OpenCV's older names take the second row's layout.
_BAYER = {
    'rggb': cv2.COLOR_BayerBG2BGR,
    'bggr': cv2.COLOR_BayerRG2BGR,
    'gbrg': cv2.COLOR_BayerGR2BGR,
    'grbg': cv2.COLOR_BayerGB2BGR,
}

_ENCODINGS = {
    'mono8': _PixelLayout(),
    '8UC1': _PixelLayout(),
    'mono16': _PixelLayout(bits=16),
    '16UC1': _PixelLayout(bits=16),
    'bgr8': _PixelLayout(channels=3),
    '8UC3': _PixelLayout(channels=3),
    'bgr16': _PixelLayout(channels=3, bits=16),
    'rgb8': _PixelLayout(channels=3, conversion=cv2.COLOR_RGB2BGR),
    'rgb16': _PixelLayout(channels=3, bits=16, conversion=cv2.COLOR_RGB2BGR),
    'bgra8': _PixelLayout(channels=4, conversion=cv2.COLOR_BGRA2BGR),
    'rgba8': _PixelLayout(channels=4, conversion=cv2.COLOR_RGBA2BGR),
    'yuv422': _PixelLayout(channels=2, conversion=cv2.COLOR_YUV2BGR_UYVY),
    'uyvy': _PixelLayout(channels=2, conversion=cv2.COLOR_YUV2BGR_UYVY),
    'yuv422_yuy2': _PixelLayout(channels=2, conversion=cv2.COLOR_YUV2BGR_YUY2),
    'yuyv': _PixelLayout(channels=2, conversion=cv2.COLOR_YUV2BGR_YUY2),
    **{f'bayer_{name}8': _PixelLayout(conversion=code) for name, code in _BAYER.items()},
    **{f'bayer_{name}16': _PixelLayout(bits=16, conversion=code) for name, code in _BAYER.items()},
}


def decode_image(message: Any, where: str) -> Image:
    """
    Return the pixels of a sensor_msgs/Image.

    where : file and topic, for the error
    :returns: (height, width) mono or (height, width, 3) BGR, uint8 or uint16
    :raises BagError: the encoding is unknown, or the size of the data does not fit the message
    """
    layout = _ENCODINGS.get(message.encoding)
    if layout is None:
        known = ', '.join(_ENCODINGS)
        raise BagError(f'{where}: encoding {message.encoding!r} is not one of {known}')
    image = _array(message, layout, where)
    if layout.conversion is None:
        return cast(Image, image)
    try:
        return cast(Image, cv2.cvtColor(np.ascontiguousarray(image), layout.conversion))
    except cv2.error as error:
        size = f'{message.width} x {message.height}'
        raise BagError(f'{where}: {size} pixels are not a {message.encoding} image') from error


def decode_compressed(message: Any, where: str) -> Image:
    """
    Return the pixels of a sensor_msgs/CompressedImage.

    where : file and topic, for the error
    :returns: (height, width) mono or (height, width, 3) BGR, uint8 or uint16
    :raises FileError: the image is cut off or damaged
    :raises BagError: the image is neither JPEG nor PNG
    """
    data = bytes(message.data)
    if data and not (is_jpeg(data) or is_png(data)):
        raise BagError(f'{where}: format {message.format!r} cannot be read, only JPEG and PNG')
    return decode_picture(data, where)


def _array(message: Any, layout: _PixelLayout, where: str) -> NDArray[Any]:
    """Return the pixels without conversion, (height, width) or (height, width, channels)."""
    height, width = int(message.height), int(message.width)
    size = layout.bits // 8
    row = width * layout.channels * size
    # some drivers send step 0
    step = int(message.step) or row
    data = np.frombuffer(message.data, dtype=np.uint8)
    if not height or not width or step < row or data.size != step * height:
        raise BagError(
            f'{where}: {data.size} bytes in rows of {step} are not a {width} x {height} '
            f'{message.encoding} image'
        )
    rows = np.ascontiguousarray(data.reshape(height, step)[:, :row])
    order = '>' if message.is_bigendian else '<'
    values = rows.view(np.dtype(f'{order}u{size}'))
    # OpenCV takes no pixels between two addresses of 16 bits, where a bag may have them
    aligned = np.require(values, requirements='A')
    native = aligned.astype(aligned.dtype.newbyteorder('='), copy=False)
    return native if layout.channels == 1 else native.reshape(height, width, layout.channels)
