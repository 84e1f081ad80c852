# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The color of the surface, from a picture with the laser off, onto the points."""

from dataclasses import replace

import cv2
import numpy as np

from ivfmc_ros.model import Bytes
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Image
from ivfmc_ros.model import Profile


def coloured(profile: Profile, picture: Image) -> Profile:
    """
    Return the profile with the colours that a picture shows at its points.

    picture : (h, w) mono or (h, w, 3) BGR, uint8 or uint16, taken at the same table angle with
        all lasers off
    """
    return replace(profile, color=colours(profile.uv, picture))


def colours(uv: Floats, picture: Image) -> Bytes:
    """Return red, green and blue (n, 3) uint8 of a picture at pixels (n, 2), interpolated."""
    if not len(uv):
        return np.zeros((0, 3), dtype=np.uint8)
    u, v = np.ascontiguousarray(uv.T[..., None], dtype=np.float32)
    # a grid of one column: the border of the picture repeats
    seen = np.asarray(
        cv2.remap(picture, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    ).reshape(len(uv), -1)
    if seen.dtype == np.uint16:
        seen = seen // 257
    # OpenCV has blue first
    return np.ascontiguousarray(np.broadcast_to(seen[:, ::-1], (len(uv), 3)), dtype=np.uint8)
