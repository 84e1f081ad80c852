# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Takes from a picture what is in it without the laser."""

from dataclasses import replace
import math
from typing import Any

import cv2
import numpy as np

from ivfmc_ros.model import Frame
from ivfmc_ros.model import Image
from ivfmc_ros.stripe.noise import Noise


def lit_by_laser(frame: Frame) -> Image:
    """
    Return the picture of a frame less its dark one; as it is, where there is none.

    A pixel at full scale stays there: what is left of a clipped one measures nothing, and has to
    be known as clipped.
    """
    if frame.dark is None:
        return frame.image
    full = np.iinfo(frame.image.dtype).max
    clipped = frame.image == full
    difference: Any = cv2.subtract(frame.image, frame.dark)
    difference[clipped] = full
    return difference  # type: ignore[no-any-return]


def of_difference(noise: Noise | None) -> Noise:
    """Return the noise of such a difference: both pictures were read."""
    noise = noise or Noise()
    return replace(noise, read=math.sqrt(2.0) * noise.read)
