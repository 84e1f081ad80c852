# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which colours of a picture measure the stripe."""

from collections.abc import Iterable
from typing import cast

import cv2
import numpy as np

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Image

# OpenCV's order of colours
_COLOURS = ('blue', 'green', 'red')

# A colour that is clipped on more than this share of the rows has lost the stripe's centre.
_MAX_CLIPPED_ROWS = 0.10
_CLIPPED = 250 / 255


def weights_of(channel: str) -> Floats:
    """
    Return the (3,) weights of blue, green and red of a channel such as 'red' or 'blue+red'.

    :raises ParameterError: it names something else than colours
    """
    colours = channel.split('+')
    if not set(colours) <= set(_COLOURS) or len(set(colours)) != len(colours):
        raise ParameterError(
            f"channel: {channel!r} is neither 'auto' nor colours joined by +: "
            f'{", ".join(_COLOURS)}'
        )
    weights = np.array([float(colour in colours) for colour in _COLOURS])
    return np.asarray(weights / weights.sum())


def to_grey(image: Image, channel: str) -> Image:
    """
    Make one channel of a picture: the mean of the colours that ``channel`` names.

    image : (h, w) mono, returned as it is, or (h, w, 3) BGR; uint8 or uint16
    channel : colours, or 'auto' for those that do not saturate in this picture
    returns : (h, w), dtype of ``image``
    """
    if image.ndim == 2:
        return image
    weights = weights_of(resolved(image, channel))
    return cast(Image, cv2.transform(image, weights.reshape(1, 3)))


def resolved(image: Image, channel: str) -> str:
    """Return the colours that ``channel`` means for this picture, as ``to_grey`` sees it."""
    return unclipped_channel([image]) if channel == 'auto' else channel


def unclipped_channel(images: Iterable[Image]) -> str:
    """
    Name the colours that do not saturate on the stripe.

    A laser of one colour drives its own channel of a Bayer sensor into saturation long before
    the others; those still have a peak. All colours that are clipped on at most a tenth of the
    rows count equally; if every colour is clipped more, the least clipped one counts.

    images : some pictures of the scan, (h, w) mono or (h, w, 3) BGR, one stripe point a row
    """
    found = (_clipped_rows(image) for image in images if image.ndim == 3)
    shares = [share for share in found if share is not None]
    if not shares:
        return '+'.join(_COLOURS)
    clipped = np.mean(shares, axis=0)
    limit = max(_MAX_CLIPPED_ROWS, float(clipped.min()))
    return '+'.join(
        colour for colour, share in zip(_COLOURS, clipped, strict=True) if share <= limit
    )


def _clipped_rows(image: Image) -> Floats | None:
    """
    Return for each colour the share of the lit rows whose brightest pixel is clipped, (3,).

    A picture without a lit row says nothing: None.
    """
    full = np.iinfo(image.dtype).max
    brightest = image.max(axis=1)
    lit = brightest.max(axis=1) > 0.4 * full
    if not lit.any():
        return None
    return np.asarray((brightest[lit] >= _CLIPPED * full).mean(axis=0))
