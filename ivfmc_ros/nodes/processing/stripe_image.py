# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Debug image of the triangulator: the camera image with the extracted laser stripe."""

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
# Seconds between two images: enough to follow the stripe, at 10 ms each for the JPEG.
PERIOD_S = 0.2
_GREEN = (80, 255, 80)


class StripeImagePublisher:
    """Publishes at most 5 images a second, and only while the topic has a subscription."""

    def __init__(self, node: CellNode) -> None:
        self._node = node
        self._publisher = node.publish_on(CompressedImage, TOPIC)
        self._published_s = -PERIOD_S

    def publish(self, frame: Frame, profile: Profile) -> None:
        """Publish an image unless the last one is too recent or there is no subscription."""
        now = self._node.steady_s()
        if now - self._published_s < PERIOD_S or not self._publisher.get_subscription_count():
            return
        self._published_s = now
        self._publisher.publish(
            images.to_jpeg(draw_stripe(frame.image, profile.uv), frame.stamp_ns)
        )


def draw_stripe(image: Image, uv: Floats) -> Image:
    """
    Return an 8-bit BGR copy of an image with the stripe marked on both sides.

    image : (height, width) mono or (height, width, 3) BGR, 8 or 16 bits
    uv : (n, 2) pixels (column, row)
    """
    small = image if image.dtype == np.uint8 else (image >> 8).astype(np.uint8)
    mono = small.ndim == 2
    marked = cast(Image, cv2.cvtColor(small, cv2.COLOR_GRAY2BGR) if mono else small.copy())
    height, width = marked.shape[:2]
    column, row = np.round(uv).astype(int).T
    for side in (-3, 3):
        # beside the stripe, which stays visible
        marked[np.clip(row, 0, height - 1), np.clip(column + side, 0, width - 1)] = _GREEN
    return marked
