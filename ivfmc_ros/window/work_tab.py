# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The tab with the camera's picture, the stripe in it, and what can be adjusted."""

from collections.abc import Callable
from collections.abc import Sequence
import math
import threading
from typing import Any

import cv2
import numpy as np

from ivfmc_ros.model import Image
from ivfmc_ros.window.actions import Actions
from ivfmc_ros.window.actions import answered
from ivfmc_ros.window.row_drawing import row_svg
from ivfmc_ros.window.status_text import STATUS
from ivfmc_ros.window.stripe_advice import StripeShares

# Greatest side of the picture in the browser, pixels.
_SIDE = 640
_QUALITY = 70
# Color of the marked row: that of its gray values.
_ROW_RGB = (0, 114, 178)
_JOG = math.radians(10.0)
# A slider that is dragged sends many values; the last one counts after this time, seconds.
_SETTLE_S = 0.3


class WorkTab:
    """The picture with its stripe, the gray values of one row, exposure, lasers, table."""

    def __init__(self, gui: Any, actions: Actions, lasers: Sequence[str], size: Any) -> None:
        """
        Add the elements to the container that is open in ``gui``.

        size : (width, height) of the camera's images
        """
        self._actions = actions
        self._shown: Image | None = None
        self._timers: dict[str, threading.Timer] = {}
        blank = np.full((round(_SIDE * size[1] / size[0]), _SIDE, 3), 40, dtype=np.uint8)
        self._picture = gui.add_image(blank, label='Camera', format='jpeg', jpeg_quality=_QUALITY)
        self._judgement = gui.add_html('<div role="status">no picture yet</div>')
        self._row = gui.add_slider('Row', 0, size[1] - 1, 1, size[1] // 2)
        self._plot = gui.add_html('')
        self._row.on_update(lambda _: self._draw_row())
        self._exposure = self._slider(gui, 'Exposure, ms', ('camera', 'exposure'), 30.0, 1e-3)
        self._gain = self._slider(gui, 'Gain', ('camera', 'gain'), 20.0, 1.0)
        self._power = self._slider(gui, 'Laser power', ('turntable', 'laser_power'), 1.0, 1.0)
        self._manual = []
        for laser in lasers:
            for on in (True, False):
                text = f'Laser {laser} {"on" if on else "off"}'
                button = gui.add_button(text, icon='bulb' if on else 'bulb-off')
                button.on_click(self._light(laser, on))
                self._manual.append(button)
        for text, angle in (('Table -10°', -_JOG), ('Table +10°', _JOG)):
            button = gui.add_button(text, icon='rotate')
            button.on_click(self._jog(angle))
            self._manual.append(button)

    def set_values(self, exposure: float, gain: float, power: float) -> None:
        """Show the present exposure (seconds), gain and laser power (0 to 1)."""
        values = ((self._exposure, 1e3 * exposure), (self._gain, gain), (self._power, power))
        for slider, value in values:
            slider.value = min(max(value, slider.min), slider.max)

    def permit(self, idle: bool) -> None:
        """Enable what moves or lights by hand: only in an idle cell."""
        for button in self._manual:
            button.disabled = not idle

    def show_picture(self, image: Image, shares: StripeShares | None) -> None:
        """
        Show a picture.

        image : (height, width) mono or (height, width, 3) BGR, uint8
        shares : of the stripe in it; None if it was not searched
        """
        self._shown = image
        self._judgement.content = _judgement(shares)
        self._draw_row()

    def _draw_row(self) -> None:
        """Draw the gray values of the row, and the row into the picture."""
        image = self._shown
        if image is None:
            return
        row = min(int(self._row.value), image.shape[0] - 1)
        self._picture.image = _small(image, row)
        self._plot.content = f'<div style="padding:0 0.6em">{row_svg(image, row)}</div>'

    def _slider(
        self, gui: Any, label: str, target: tuple[str, str], high: float, unit: float
    ) -> Any:
        slider = gui.add_slider(label, 0.0 if unit == 1.0 else 0.1, high, 0.1, 1.0)

        def settle(event: Any) -> None:
            value = float(slider.value) * unit
            # a value that the program sets comes without a client
            if event.client is None:
                return
            earlier = self._timers.get(label)
            if earlier is not None:
                earlier.cancel()
            timer = threading.Timer(
                _SETTLE_S,
                lambda: answered(event, lambda: self._actions.set_value(*target, value), ''),
            )
            timer.daemon = True
            self._timers[label] = timer
            timer.start()

        slider.on_update(settle)
        return slider

    def _light(self, laser: str, on: bool) -> Callable[[Any], None]:
        def on_click(event: Any) -> None:
            done = f'Laser {laser} is {"on" if on else "off"}'
            answered(event, lambda: self._actions.light(laser, on), done)

        return on_click

    def _jog(self, angle: float) -> Callable[[Any], None]:
        def on_click(event: Any) -> None:
            answered(event, lambda: self._actions.jog(angle), '')

        return on_click


def _small(image: Image, row: int) -> Image:
    """Return an 8-bit RGB copy that fits the page, with a row marked at both edges."""
    scale = _SIDE / max(image.shape[:2])
    size = (round(image.shape[1] * scale), round(image.shape[0] * scale))
    small: Any = cv2.resize(image, size, interpolation=cv2.INTER_AREA) if scale < 1.0 else image
    code = cv2.COLOR_GRAY2RGB if small.ndim == 2 else cv2.COLOR_BGR2RGB
    rgb: Any = cv2.cvtColor(small, code)
    # not across: the stripe under it must stay visible
    place, length = round((row + 0.5) * min(scale, 1.0) - 0.5), rgb.shape[1] // 12
    for ends in ((0, length), (rgb.shape[1] - length, rgb.shape[1] - 1)):
        cv2.line(rgb, (ends[0], place), (ends[1], place), _ROW_RGB, 2)
    return np.asarray(rgb, dtype=np.uint8)


def _judgement(shares: StripeShares | None) -> str:
    if shares is None:
        return _block('camera picture; no stripe is searched in it')
    parts = f'{shares.rows} rows: ' + ', '.join(
        f'{value:.0%} {name}'
        for name, value in (
            ('saturated', shares.saturated),
            ('weak', shares.weak),
            ('missing', shares.missing),
            ('uncertain', shares.uncertain),
        )
    )
    advice = shares.advice or 'the stripe is good'
    return _block(f'<b>{advice}</b><br><small>{parts}</small>')


def _block(content: str) -> str:
    return f'<div {STATUS} style="padding:0 0.6em">{content}</div>'
