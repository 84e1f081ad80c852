# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Significant bits of 16-bit images, and their scaling to the full range of the pixel type.

Cameras with 10, 12 or 14 bits send them in the low bits of 16 (mono16 of the camera drivers, PNG
files), where full scale is 1023, 4095 or 16383 and not 65535. Neither message nor file says so.
"""

from collections.abc import Iterable
from typing import cast

import numpy as np

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.model import Image

# The number of bits is not known.
UNKNOWN = 0
_PIXEL_BITS = 16
# Fewer bits do not come in 16-bit images: those would be 8-bit images.
_MIN_BITS = 8
# Bit depths of industrial cameras, besides 16.
_CAMERA_BITS = (10, 12, 14)


def require_image_bits(value: int) -> None:
    """:raises ParameterError: the number of bits is neither 0 (unknown) nor 8 to 16."""
    if value != UNKNOWN and not _MIN_BITS <= value <= _PIXEL_BITS:
        raise ParameterError(f'image_bits: {value} must be 8 to 16, or 0 for unknown')


def to_full_scale(image: Image, bits: int, where: str) -> Image:
    """
    Return a 16-bit image of ``bits`` significant bits with full scale at 65535; others unchanged.

    where : of the image, for the error
    :raises ParameterError: the image has a value that needs more bits
    """
    if image.dtype != np.uint16 or bits in (UNKNOWN, _PIXEL_BITS):
        return image
    brightest = int(image.max(initial=0))
    if brightest >= 1 << bits:
        raise ParameterError(
            f'image_bits: {bits} bits hold values up to {(1 << bits) - 1}, {where} has '
            f'{brightest}; set image_bits to {brightest.bit_length()} or more'
        )
    # the high bits are repeated below, so that full scale becomes 65535 and black stays 0
    return cast(Image, (image << (_PIXEL_BITS - bits)) | (image >> (2 * bits - _PIXEL_BITS)))


def require_known_bits(images: Iterable[Image], bits: int) -> None:
    """
    Refuse 16-bit images that look like fewer bits, while the number is not known.

    images : some of a scan; 8-bit images say nothing
    bits : as the user gave it
    :raises ParameterError: no image uses the upper two bits, and the low ones are used
    """
    if bits != UNKNOWN:
        return
    count, brightest, used = 0, 0, 0
    for image in images:
        if image.dtype == np.uint16:
            count += 1
            brightest = max(brightest, int(image.max(initial=0)))
            used |= int(np.bitwise_or.reduce(image, axis=None))
    fewer = [known for known in _CAMERA_BITS if brightest < 1 << known]
    if not count or not fewer or _is_left_aligned(used):
        return
    raise ParameterError(
        f'image_bits: the brightest of 65535 is {brightest} in {count} pictures; the camera looks '
        f'like {fewer[0]} bits: set extract.image_bits: {fewer[0]} (--image-bits on the command '
        'line), or 16 if the pictures are that dark'
    )


def _is_left_aligned(used: int) -> bool:
    """Return whether the low bits are never set: the camera's bits are the upper ones."""
    return used == 0 or used & ((1 << (_PIXEL_BITS - max(_CAMERA_BITS))) - 1) == 0
