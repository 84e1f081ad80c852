# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Selection of the color channels that measure the stripe, and conversion to gray."""

from collections.abc import Iterable
from typing import cast

import cv2
import numpy as np

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Image

# Channel order of OpenCV images
_COLORS = ('blue', 'green', 'red')

# A channel that saturates on more than this fraction of the rows is not used.
_MAX_CLIPPED_ROWS = 0.10
# Fraction of full scale from which a pixel counts as saturated; JPEG lowers full scale a little.
_CLIPPED = 250 / 255


def channel_weights(channel: str) -> Floats:
    """
    Return the (3,) weights (blue, green, red) of a channel such as 'red' or 'blue+red'.

    :raises ParameterError: an unknown color, or one is repeated
    """
    colors = channel.split('+')
    if not set(colors) <= set(_COLORS) or len(set(colors)) != len(colors):
        raise ParameterError(
            f"channel: {channel!r} must be 'auto' or colors joined by +: {', '.join(_COLORS)}"
        )
    weights = np.array([float(color in colors) for color in _COLORS])
    return np.asarray(weights / weights.sum())


def to_gray(image: Image, channel: str) -> Image:
    """
    Convert an image to gray: the mean of the color channels that ``channel`` names.

    image : (h, w) mono, returned unchanged, or (h, w, 3) BGR; uint8 or uint16
    channel : colors joined by +, or 'auto' for those that do not saturate in this image
    returns : (h, w), dtype of ``image``
    """
    if image.ndim == 2:
        return image
    weights = channel_weights(resolve_channel(image, channel))
    return cast(Image, cv2.transform(image, weights.reshape(1, 3)))


def resolve_channel(image: Image, channel: str) -> str:
    """Return the colors that ``channel`` selects in this image; resolves auto."""
    return unclipped_channel([image]) if channel == 'auto' else channel


def unclipped_channel(images: Iterable[Image]) -> str:
    """
    Return the color channels that do not saturate on the stripe, such as 'blue+red'.

    A laser saturates the channel of its own color long before the others. All channels that
    saturate on at most a tenth of the rows are used; if there is none, the least saturated one.

    images : sample images of the scan, (h, w) mono or (h, w, 3) BGR, one stripe point per row
    """
    found = (_clipped_rows(image) for image in images if image.ndim == 3)
    shares = [share for share in found if share is not None]
    if not shares:
        return '+'.join(_COLORS)
    clipped = np.mean(shares, axis=0)
    limit = max(_MAX_CLIPPED_ROWS, float(clipped.min()))
    return '+'.join(color for color, share in zip(_COLORS, clipped, strict=True) if share <= limit)


def _clipped_rows(image: Image) -> Floats | None:
    """
    Return the fraction of the lit rows whose brightest pixel saturates, per color, (3,).

    None if the image has no lit row.
    """
    full = np.iinfo(image.dtype).max
    brightest = image.max(axis=1)
    lit = brightest.max(axis=1) > 0.4 * full
    if not lit.any():
        return None
    return np.asarray((brightest[lit] >= _CLIPPED * full).mean(axis=0))
