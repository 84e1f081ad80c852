# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The gray values of one row of an image, as SVG.

A plotting element of the page has no size while its tab is hidden, and keeps it afterwards.
"""

import numpy as np

from ivfmc_ros.model import Image

_WIDTH, _HEIGHT = 400, 150
_LEFT, _RIGHT, _TOP, _BOTTOM = 30, 6, 18, 20
_INK, _LINE = '#1c2530', '#0072b2'
# Greatest number of points of the curve: more than the page has pixels across.
_POINTS = 480


def row_svg(image: Image, row: int) -> str:
    """
    Return the gray values along a row, DN, from 0 to full scale.

    image : (height, width) or (height, width, 3), 8 or 16 bits; of colors the brightest counts
    """
    gray = (image if image.ndim == 2 else image.max(axis=2))[row].astype(np.float64)
    full = float(np.iinfo(image.dtype).max)
    # the greatest of neighboring columns: a saturated pixel must not vanish
    step = -(-len(gray) // _POINTS)
    padded = np.pad(gray, (0, -len(gray) % step), mode='edge')
    values = padded.reshape(-1, step).max(axis=1)
    inner = _WIDTH - _LEFT - _RIGHT, _HEIGHT - _TOP - _BOTTOM
    x = _LEFT + inner[0] * np.arange(len(values)) * step / max(len(gray) - 1, 1)
    y = _TOP + inner[1] * (1.0 - values / full)
    points = ' '.join(
        f'{u:.1f},{v:.1f}' for u, v in zip(x.clip(max=_WIDTH - _RIGHT), y, strict=True)
    )
    floor = _HEIGHT - _BOTTOM
    label = f'gray values of row {row}, DN; highest {gray.max():.0f} in column {gray.argmax()}'
    return (
        f'<svg role="img" aria-label="{label}" viewBox="0 0 {_WIDTH} {_HEIGHT}" font-size="11" '
        f'style="width:100%;display:block"><text x="{_LEFT}" y="11" fill="{_INK}">{label}</text>'
        f'<path d="M{_LEFT} {_TOP}V{floor}H{_WIDTH - _RIGHT}" fill="none" stroke="#888"/>'
        f'<path d="M{_LEFT} {_TOP}H{_WIDTH - _RIGHT}" stroke="#888" stroke-dasharray="4 4"/>'
        f'<text x="2" y="{_TOP + 4}" fill="{_INK}">{full:.0f}</text>'
        f'<text x="2" y="{floor}" fill="{_INK}">0</text>'
        f'<text x="{_LEFT}" y="{_HEIGHT - 6}" fill="{_INK}">column 0</text>'
        f'<text x="{_WIDTH - _RIGHT}" y="{_HEIGHT - 6}" fill="{_INK}" text-anchor="end">'
        f'{len(gray) - 1}</text>'
        f'<polyline points="{points}" fill="none" stroke="{_LINE}" stroke-width="1.2"/></svg>'
    )
