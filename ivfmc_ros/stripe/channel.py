# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which colours of a picture measure the stripe."""

from collections.abc import Iterable
from typing import cast
from typing import Literal

import cv2
import numpy as np

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Image

Channel = Literal['blend', 'mono', 'blue', 'green', 'red']

# OpenCV's order of colours
_WEIGHTS: dict[str, tuple[float, float, float]] = {
    'blend': (1 / 3, 1 / 3, 1 / 3),
    'mono': (0.114, 0.587, 0.299),
    'blue': (1.0, 0.0, 0.0),
    'green': (0.0, 1.0, 0.0),
    'red': (0.0, 0.0, 1.0),
}
# A colour that is clipped on more than this share of the rows has lost the stripe's centre.
_MAX_CLIPPED_ROWS = 0.10
_CLIPPED = 250 / 255


def weights_of(channel: str) -> Floats:
    """
    Return the (3,) weights of blue, green and red of a named channel.

    :raises ParameterError: there is no such channel
    """
    if channel not in _WEIGHTS:
        raise ParameterError(f'channel: {channel!r} is not one of auto, {", ".join(_WEIGHTS)}')
    return np.array(_WEIGHTS[channel])


def to_grey(image: Image, weights: Floats) -> Image:
    """
    Weigh the colours of a picture into one.

    image : (h, w) mono, returned as it is, or (h, w, 3) BGR; uint8 or uint16
    weights : (3,) of blue, green, red, with sum 1
    returns : (h, w), dtype of ``image``
    """
    if image.ndim == 2:
        return image
    return cast(Image, cv2.transform(image, weights.reshape(1, 3)))


def measuring_weights(images: Iterable[Image]) -> Floats:
    """
    Choose the weights of the colours that do not saturate on the stripe.

    A laser of one colour drives its own channel of a Bayer sensor into saturation long before
    the others; those still have a peak. All colours that are clipped on at most a tenth of the
    rows are weighed equally; if every colour is clipped, the one that is clipped least is used.

    images : some pictures of the scan, (h, w) mono or (h, w, 3) BGR
    returns : (3,) float64 with sum 1
    """
    shares = [_clipped_rows(image) for image in images if image.ndim == 3]
    if not shares:
        return weights_of('blend')
    clipped = np.mean(shares, axis=0)
    usable = clipped <= max(_MAX_CLIPPED_ROWS, float(clipped.min()))
    return np.asarray(usable / usable.sum())


def _clipped_rows(image: Image) -> Floats:
    """Return the (3,) share of the rows whose brightest pixel is clipped."""
    full = np.iinfo(image.dtype).max
    brightest = image.max(axis=1)
    lit = brightest.max(axis=1) > 0.4 * full
    if not lit.any():
        return np.zeros(3)
    return np.asarray((brightest[lit] >= _CLIPPED * full).mean(axis=0))
