# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What of a picture is looked at, and what the rest of it tells of its noise."""

from dataclasses import dataclass
import math
from typing import Any
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from ivfmc_ros.cell.laser import Stripe as Direction
from ivfmc_ros.model import Bytes
from ivfmc_ros.model import Image
from ivfmc_ros.stripe import channel
from ivfmc_ros.stripe.peaks import measured_at
from ivfmc_ros.stripe.region import Region
from ivfmc_ros.stripe.settings import ExtractSettings

# Noise and darkness of a picture are told from pairs of pixels this far apart.
_EVERY = 20


@dataclass(frozen=True, eq=False)
class Part:
    """
    One channel of a part of a picture, turned so that there is one stripe point a row.

    grey : (rows, columns) uint8 or uint16; times ``scale`` it is in grey values of 0 to 255
    mask : (rows, columns) uint8, 255 where the stripe can be, else 0; None for everywhere
    first : (row, column) of the part in the turned picture, which has so many ``columns``
    noise : standard deviation of the whole picture's dark pixels, steps of its grey values
    dark : median of the whole picture, steps of its grey values
    """

    grey: Image
    mask: Bytes | None
    scale: float
    first: tuple[int, int]
    columns: int
    noise: float
    dark: float

    @classmethod
    def of(
        cls,
        image: Image,
        stripe: Direction,
        settings: ExtractSettings,
        region: Region | None = None,
    ) -> 'Part':
        """Return the part of a picture that ``extract`` has to look at."""
        by_row = stripe == 'rows'
        window, mask = (slice(0, None), slice(0, None)), None
        if region is not None:
            window = region.window(stripe, _reach(settings))
            mask = cast(Bytes, _turned(region.mask[window], by_row))
        part = _turned(image[window], by_row)
        colours = channel.resolved(part, settings.channel)
        noise, dark = ground(image if by_row else np.swapaxes(image, 0, 1), colours)
        first = (window[0].start, window[1].start)
        return cls(
            grey=channel.to_grey(part, colours),
            mask=mask,
            scale=255.0 / float(np.iinfo(image.dtype).max),
            first=first if by_row else first[::-1],
            columns=image.shape[1 if by_row else 0],
            noise=noise,
            dark=dark,
        )


def _reach(settings: ExtractSettings) -> int:
    """Return how far from a peak's smoothed maximum extraction looks, pixels."""
    # a half of the widest peak reaches 1.2 sigmas farther on one side than on the other
    estimate = (settings.window + 1.2) * settings.max_sigma + 3.0
    search = float(measured_at(settings.max_sigma)[-1])
    return math.ceil(max(estimate, search)) + settings.smoothing


def _turned(image: Image, by_row: bool) -> Image:
    return image if by_row else cast(Image, cv2.transpose(image))


def ground(image: Image, colours: str) -> tuple[float, float]:
    """
    Return the standard deviation and the brightness of a picture's dark pixels.

    They are medians over neighbours on a coarse grid, of which stripes cover little. The first
    is interpolated between grey values, or it could be no finer than one.
    """
    # 21 and 8 have no common factor: the pairs fall inside and across the blocks of a JPEG
    left, right = (_sampled(image, shift, colours) for shift in (0, 1))
    if not right.size:
        return 0.0, 0.0
    steps = np.ravel(cv2.absdiff(left[:, : right.shape[1]], right))
    middle = _middle(steps)
    below, at = np.count_nonzero(steps < middle), np.count_nonzero(steps == middle)
    low = middle - 0.5 if middle else 0.0
    median = low + (middle + 0.5 - low) * (0.5 * len(steps) - below) / at
    return float(median / 0.6745 / np.sqrt(2.0)), float(_middle(left.ravel()))


def _sampled(image: Image, shift: int, colours: str) -> Image:
    few = image[::_EVERY, shift :: _EVERY + 1]
    return channel.to_grey(cast(Image, np.ascontiguousarray(few)), colours)


def _middle(values: NDArray[Any]) -> int:
    return int(np.partition(values, len(values) // 2)[len(values) // 2])
