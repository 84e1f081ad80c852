# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Ambient light subtraction: the image with the laser on minus the one with the lasers off."""

from dataclasses import replace
import math
from typing import Any

import cv2
import numpy as np

from ivfmc_ros.model import Frame
from ivfmc_ros.model import Image
from ivfmc_ros.stripe.noise import SensorNoise


def subtract_ambient(frame: Frame) -> Image:
    """
    Return the image of a frame minus its dark image; unchanged if the frame has none.

    A saturated pixel keeps the full-scale value, so that later steps still see it as saturated.
    """
    if frame.dark is None:
        return frame.image
    full = np.iinfo(frame.image.dtype).max
    clipped = frame.image == full
    difference: Any = cv2.subtract(frame.image, frame.dark)
    difference[clipped] = full
    return difference  # type: ignore[no-any-return]


def noise_of_difference(noise: SensorNoise | None) -> SensorNoise:
    """Return the noise model of the difference: read noise of both images, sqrt(2) times one."""
    noise = noise or SensorNoise()
    return replace(noise, read=math.sqrt(2.0) * noise.read)
