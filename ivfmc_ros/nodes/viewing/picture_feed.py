# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Camera pictures for the page: those with the stripe in a scan, else those of the camera."""

from typing import Any

from sensor_msgs.msg import CompressedImage
from sensor_msgs.msg import Image as ImageMessage

from ivfmc_ros.errors import ScanError
from ivfmc_ros.model import Image
from ivfmc_ros.model import Profile
from ivfmc_ros.nodes.convert import images
from ivfmc_ros.nodes.framework import qos
from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.nodes.processing.stripe_image import TOPIC
from ivfmc_ros.nodes.viewing.cell_actions import CellActions
from ivfmc_ros.window.page import WorkPage
from ivfmc_ros.window.stripe_advice import stripe_shares

# Seconds between two pictures on the page.
_PERIOD_S = 0.4
# Seconds after the last picture with a stripe in which it is shown instead of the camera's.
_STRIPE_S = 1.0


class PictureFeed:
    """
    Subscribes to pictures only while a browser shows the page.

    profile : the last one, by which the stripe in a picture is judged
    """

    def __init__(self, node: CellNode, page: WorkPage, actions: CellActions) -> None:
        self.profile: Profile | None = None
        self._node, self._page, self._actions = node, page, actions
        self._stripe: Any = None
        self._raw: Any = None
        self._shown_s = self._stripe_s = -_STRIPE_S
        self._has_values = False

    def follow(self, *, wanted: bool, scanning: bool) -> None:
        """Subscribe or not: pictures are wanted, and a scan has its own."""
        self._stripe = self._subscribed(
            self._stripe, wanted, CompressedImage, TOPIC, self._receive_stripe
        )
        # the triangulator takes the pictures of a scan; a second reader of them costs it time
        self._raw = self._subscribed(
            self._raw, wanted and not scanning, ImageMessage, 'image_raw', self._receive_raw
        )
        if wanted and not self._has_values:
            self._has_values = True
            self._node.executor.create_task(self._show_values)

    def _subscribed(self, now: Any, wanted: bool, kind: type, topic: str, callback: Any) -> Any:
        if wanted and now is None:
            guarded = self._node.guarded(callback, topic)
            return self._node.create_subscription(kind, topic, guarded, qos.best_effort(1))
        if not wanted and now is not None:
            self._node.destroy_subscription(now)
            return None
        return now

    async def _show_values(self) -> None:
        """Show exposure, gain and power as they are now."""
        get = self._actions.read
        try:
            exposure, gain = await get('camera', 'exposure'), await get('camera', 'gain')
            power = await get('turntable', 'laser_power')
        except ScanError:
            # drivers of other packages have none of them
            self._has_values = False
            return
        self._page.work.set_values(exposure or 0.005, gain or 1.0, power or 1.0)

    def _receive_stripe(self, message: CompressedImage) -> None:
        self._stripe_s = self._node.steady_s()
        if not self._is_due():
            return
        picture = images.from_image(message, TOPIC)
        profile = self.profile
        shares = None
        if profile is not None:
            shares = stripe_shares(picture, profile.uv, profile.intensity, profile.sigma)
        self._page.work.show_picture(picture, shares)

    def _receive_raw(self, message: ImageMessage) -> None:
        is_stripe_shown = self._node.steady_s() - self._stripe_s < _STRIPE_S
        if is_stripe_shown or not self._is_due():
            return
        picture = _bytes_of(images.from_image(message, 'image_raw'))
        self._page.work.show_picture(picture, None)
        if self._page.calibrate.active:
            self._node.in_thread(self._page.calibrate.judge, picture)

    def _is_due(self) -> bool:
        now = self._node.steady_s()
        if now - self._shown_s < _PERIOD_S:
            return False
        self._shown_s = now
        return True


def _bytes_of(image: Image) -> Image:
    """Return an 8-bit picture."""
    return image if image.dtype.itemsize == 1 else (image >> 8).astype('uint8')
