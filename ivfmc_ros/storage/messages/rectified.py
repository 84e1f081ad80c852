# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rectified images: image_proc publishes them with the camera_info of the raw ones."""

import re

from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.errors import CellError

# Names of image_proc and its successors: image_rect, image_rect_color, rect/image.
_RECTIFIED = re.compile(r'(?:^|[/_])rect(?:ified)?(?:[/_]|$)')


def require_raw_images(topic: str, camera: Camera) -> None:
    """
    Refuse a topic of rectified images with a camera that has the distortion of the raw ones.

    The distortion would be removed twice, and every dimension be wrong.

    :raises CellError: the topic has the name of one, and the distortion is not zero
    """
    if _RECTIFIED.search(topic) and camera.distortion.any():
        raise CellError(
            f'{topic}: the images are rectified, and the camera has the distortion of the raw '
            'images; use the topic of the raw images, or a camera without distortion'
        )
