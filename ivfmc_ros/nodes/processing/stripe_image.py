# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The camera's picture with the stripe that was found in it, for somebody who looks."""

from typing import cast

import cv2
import numpy as np
from sensor_msgs.msg import CompressedImage

from ivfmc_ros.model import Floats
from ivfmc_ros.model import Frame
from ivfmc_ros.model import Image
from ivfmc_ros.model import Profile
from ivfmc_ros.nodes.convert import images
from ivfmc_ros.nodes.framework.base import CellNode

TOPIC = 'stripe_image/compressed'
PERIOD_S = 0.2
_GREEN = (80, 255, 80)


class StripePicture:
    """Publishes a few pictures a second, and does nothing while nobody listens."""

    def __init__(self, node: CellNode) -> None:
        self._node = node
        self._publisher = node.publish_on(CompressedImage, TOPIC)
        self._shown_s = -PERIOD_S

    def show(self, frame: Frame, profile: Profile) -> None:
        """Publish a picture, if somebody listens and it is time for one."""
        now = self._node.steady_s()
        if now - self._shown_s < PERIOD_S or not self._publisher.get_subscription_count():
            return
        self._shown_s = now
        self._publisher.publish(images.to_jpeg(drawn(frame.image, profile.uv), frame.stamp_ns))


def drawn(image: Image, uv: Floats) -> Image:
    """
    Return an 8-bit BGR picture with the stripe marked.

    uv : (n, 2) pixel (column, row)
    """
    small = image if image.dtype == np.uint8 else (image >> 8).astype(np.uint8)
    mono = small.ndim == 2
    picture = cast(Image, cv2.cvtColor(small, cv2.COLOR_GRAY2BGR) if mono else small.copy())
    height, width = picture.shape[:2]
    column, row = np.round(uv).astype(int).T
    for side in (-3, 3):
        # on either side of the stripe, so that the stripe itself stays to be seen
        picture[np.clip(row, 0, height - 1), np.clip(column + side, 0, width - 1)] = _GREEN
    return picture
