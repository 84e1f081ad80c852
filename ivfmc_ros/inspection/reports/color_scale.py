# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The color scale of a report: the same colors in pictures, in the WebGL view and in its bar."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ivfmc_ros.model import Floats

# Position on the scale, and RGB from 0 to 255.
_STOPS = (
    (0.0, (26, 56, 166)),
    (0.33, (89, 191, 217)),
    (0.5, (115, 199, 102)),
    (0.7, (242, 209, 64)),
    (1.0, (204, 31, 26)),
)
# What has no value.
NO_VALUE_RGB = (184, 191, 199)
# Pixels of a bar in a page.
_WIDTH, _HEIGHT, _MARGIN = 420, 14, 44
_STEPS = 84


@dataclass(frozen=True, kw_only=True)
class ColorBar:
    """
    What the colors of a picture mean.

    low, high : meters, at the ends of the scale
    quantity : name of what is shown
    tolerance : meters to either side of zero; None for no band
    """

    low: float
    high: float
    quantity: str
    tolerance: float | None = None

    def colors(self, values: Floats) -> NDArray[np.uint8]:
        """Return (n, 3) BGR for (n,) meters; gray where a value is NaN."""
        share = np.clip((values - self.low) / max(self.high - self.low, 1e-30), 0.0, 1.0)
        positions = [position for position, _ in _STOPS]
        rgb = np.stack(
            [np.interp(share, positions, [color[k] for _, color in _STOPS]) for k in range(3)],
            axis=1,
        )
        rgb[~np.isfinite(values)] = NO_VALUE_RGB
        return np.asarray(rgb[:, ::-1].round(), dtype=np.uint8)

    def svg(self) -> str:
        """Return the bar with its unit; the tolerance band is a bracket above it."""
        decimals = _decimals(self.high - self.low)
        marks = {self.low, 0.5 * (self.low + self.high), self.high}
        if self.tolerance is not None:
            marks |= {-self.tolerance, self.tolerance}
        ticks = ''.join(self._tick(mark, decimals) for mark in sorted(marks))
        middles = self.low + (self.high - self.low) * (np.arange(_STEPS) + 0.5) / _STEPS
        step = _WIDTH / _STEPS
        # no gradient: its id would have to be unique in the page
        boxes = ''.join(
            f'<rect x="{_MARGIN + k * step:.1f}" y="20" width="{step + 0.3:.1f}" '
            f'height="{_HEIGHT}" fill="#{r:02x}{g:02x}{b:02x}"/>'
            for k, (b, g, r) in enumerate(self.colors(middles).tolist())
        )
        width = _WIDTH + 2 * _MARGIN
        return (
            f'<svg class="bar" viewBox="0 0 {width} 58" width="{width}" font-size="12" '
            f'role="img" aria-label="{self.quantity}, mm">{boxes}{self._band(decimals)}{ticks}'
            f'<text x="{_MARGIN}" y="10">{self.quantity}, mm</text></svg>'
        )

    def _place(self, value: float) -> float:
        return _MARGIN + _WIDTH * (value - self.low) / max(self.high - self.low, 1e-30)

    def _tick(self, value: float, decimals: int) -> str:
        x = self._place(value)
        text = '0' if abs(value) < 1e-12 else f'{value * 1e3:+.{decimals}f}'
        if self.low >= 0.0:
            text = text.lstrip('+')
        return (
            f'<path d="M{x:.1f} 20v{_HEIGHT + 4}" stroke="#1c2530"/>'
            f'<text x="{x:.1f}" y="{20 + _HEIGHT + 17}" text-anchor="middle">{text}</text>'
        )

    def _band(self, decimals: int) -> str:
        if self.tolerance is None:
            return ''
        left, right = self._place(-self.tolerance), self._place(self.tolerance)
        return (
            f'<path d="M{left:.1f} 19v-5H{right:.1f}v5" fill="none" stroke="#1c2530" '
            f'stroke-width="2"/><text x="{0.5 * (left + right):.1f}" y="10" '
            f'text-anchor="middle">tolerance ±{self.tolerance * 1e3:.{decimals}f}</text>'
        )


def _decimals(span: float) -> int:
    """Return the decimals of a millimeter that a scale of ``span`` meters needs."""
    return int(np.clip(2 - np.floor(np.log10(max(span * 1e3, 1e-9))), 0, 5))


def glsl() -> str:
    """Return the function ``vec3 map(float t)`` of a fragment shader."""
    texts = [f'vec3({", ".join(f"{v / 255:.4f}" for v in color)})' for _, color in _STOPS]
    body = f'vec3 c = {texts[0]};'
    for (before, _), (after, _), text in zip(_STOPS, _STOPS[1:], texts[1:], strict=False):
        body += f' c = mix(c, {text}, clamp((t - {before:.4f}) / {after - before:.4f}, 0.0, 1.0));'
    return f'vec3 map(float t) {{ {body} return c; }}'
