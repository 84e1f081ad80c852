# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Colors of surface points, sampled from an image with the laser off."""

from dataclasses import replace

import cv2
import numpy as np

from ivfmc_ros.model import Bytes
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Image
from ivfmc_ros.model import Profile


def with_colors(profile: Profile, image: Image) -> Profile:
    """
    Return the profile with the colors of an image at its pixels ``uv``.

    image : (h, w) mono or (h, w, 3) BGR, uint8 or uint16, taken at the same table angle with
        all lasers off
    """
    return replace(profile, color=sample_colors(profile.uv, image))


def sample_colors(uv: Floats, image: Image) -> Bytes:
    """Return RGB colors (n, 3) uint8 of an image at pixels (n, 2), bilinearly interpolated."""
    if not len(uv):
        return np.zeros((0, 3), dtype=np.uint8)
    u, v = np.ascontiguousarray(uv.T[..., None], dtype=np.float32)
    # cv2.remap takes a grid: here of one column
    sampled = np.asarray(
        cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    ).reshape(len(uv), -1)
    if sampled.dtype == np.uint16:
        sampled = sampled // 257
    # OpenCV images are BGR
    return np.ascontiguousarray(np.broadcast_to(sampled[:, ::-1], (len(uv), 3)), dtype=np.uint8)
