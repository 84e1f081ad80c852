# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Gray crop of an image to its region of interest, with the noise and dark level of the image."""

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
from ivfmc_ros.stripe.peaks import sample_offsets
from ivfmc_ros.stripe.roi import RegionOfInterest
from ivfmc_ros.stripe.settings import ExtractSettings

# Rows between the pixel pairs from which the noise and the dark level of an image are estimated;
# columns: one more.
_STEP = 20


@dataclass(frozen=True, eq=False)
class CroppedImage:
    """
    A gray crop of an image, transposed if necessary so that there is one stripe point per row.

    gray : (rows, columns) uint8 or uint16
    mask : (rows, columns) uint8, 255 where the stripe can be, else 0; None for everywhere
    scale : factor from ``gray`` to gray values of 0 to 255
    first : (row, column) of the crop in the transposed image
    columns : number of columns of the whole transposed image
    noise : standard deviation of the whole image's dark pixels, in its gray values
    dark : median of the whole image, in its gray values
    """

    gray: Image
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
        region: RegionOfInterest | None = None,
    ) -> 'CroppedImage':
        """Crop an image to a region of interest, with the margin that the extraction needs."""
        by_row = stripe == 'rows'
        window, mask = (slice(0, None), slice(0, None)), None
        if region is not None:
            window = region.window(stripe, _margin(settings))
            mask = cast(Bytes, _transposed(region.mask[window], by_row))
        cropped = _transposed(image[window], by_row)
        colors = channel.resolve_channel(cropped, settings.channel)
        noise, dark = dark_statistics(image if by_row else np.swapaxes(image, 0, 1), colors)
        first = (window[0].start, window[1].start)
        return cls(
            gray=channel.to_gray(cropped, colors),
            mask=mask,
            scale=255.0 / float(np.iinfo(image.dtype).max),
            first=first if by_row else first[::-1],
            columns=image.shape[1 if by_row else 0],
            noise=noise,
            dark=dark,
        )


def _margin(settings: ExtractSettings) -> int:
    """Return how far from a peak's smoothed maximum the extraction uses pixels."""
    # the midpoint of the widest peak is up to 1.2 sigmas from its maximum
    estimate = (settings.window + 1.2) * settings.max_sigma + 3.0
    search = float(sample_offsets(settings.max_sigma)[-1])
    return math.ceil(max(estimate, search)) + settings.smoothing


def _transposed(image: Image, by_row: bool) -> Image:
    return image if by_row else cast(Image, cv2.transpose(image))


def dark_statistics(image: Image, colors: str) -> tuple[float, float]:
    """
    Return the standard deviation and the gray value of an image's dark pixels.

    Both are medians on a coarse grid, of which stripes cover little: the first of differences of
    neighboring pixels, interpolated between whole gray values, the second of the pixels.
    """
    # 21 and 8 are coprime: the pairs lie inside and across the blocks of a JPEG image
    left, right = (_sampled(image, shift, colors) for shift in (0, 1))
    if not right.size:
        return 0.0, 0.0
    steps = np.ravel(cv2.absdiff(left[:, : right.shape[1]], right))
    integer_median = _median(steps)
    below, at = np.count_nonzero(steps < integer_median), np.count_nonzero(steps == integer_median)
    low = integer_median - 0.5 if integer_median else 0.0
    median = low + (integer_median + 0.5 - low) * (0.5 * len(steps) - below) / at
    # 0.6745: median of the absolute value of a standard normal variable
    return float(median / 0.6745 / np.sqrt(2.0)), float(_median(left.ravel()))


def _sampled(image: Image, shift: int, colors: str) -> Image:
    grid = image[::_STEP, shift :: _STEP + 1]
    return channel.to_gray(cast(Image, np.ascontiguousarray(grid)), colors)


def _median(values: NDArray[Any]) -> int:
    return int(np.partition(values, len(values) // 2)[len(values) // 2])
