# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The images of a camera that publishes them raw, compressed or both."""

from collections.abc import Callable
from typing import Any

from sensor_msgs.msg import CompressedImage
from sensor_msgs.msg import Image as ImageMessage

from ivfmc_ros.nodes.framework.adaptive_subscription import AdaptiveSubscription
from ivfmc_ros.nodes.framework.base import CellNode


class ImageInput:
    """Subscribes to image_raw and image_raw/compressed, and passes each image on once."""

    def __init__(self, node: CellNode, receive: Callable[[Any], object], depth: int) -> None:
        """
        Subscribe.

        receive : called with an Image, or a CompressedImage where no raw one is published
        depth : length of the queues, images
        """
        self._receive = receive
        self.raw = AdaptiveSubscription(node, ImageMessage, 'image_raw', receive, depth=depth)
        self._compressed = AdaptiveSubscription(
            node,
            CompressedImage,
            'image_raw/compressed',
            self._receive_compressed,
            depth=depth,
        )

    @property
    def is_paused(self) -> bool:
        """Whether no images are received, by ``pause``."""
        return self.raw.is_paused

    def pause(self) -> None:
        """Receive no images until ``resume``."""
        self.raw.pause()
        self._compressed.pause()

    def resume(self) -> None:
        """Receive images again."""
        self.raw.resume()
        self._compressed.resume()

    def _receive_compressed(self, message: CompressedImage) -> None:
        # a driver that publishes both topics publishes each image twice
        if not self.raw.publishers:
            self._receive(message)
