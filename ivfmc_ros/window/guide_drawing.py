# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Drawings of a guided calibration as SVG: the image, the volume from above, the residuals."""

import base64
from html import escape
from typing import Any

import cv2
import numpy as np

from ivfmc_ros.calibration.boards.board import Corners
from ivfmc_ros.calibration.camera.calibrate import CameraCalibration
from ivfmc_ros.calibration.live.guide import CaptureGuide
from ivfmc_ros.calibration.live.guide import TYPICAL_FOCAL
from ivfmc_ros.calibration.live.proposal import Proposal
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Image

# Colors of what has seen corners, of the board as it goes next, and of corners that are detected
# now (Okabe and Ito 2008).
_SEEN, _NEXT, _NOW = '#009e73', '#d55e00', '#f0e442'
_INK = '#1c2530'
# Width of the picture in the page, pixels.
_SIDE, _QUALITY = 480, 60
_STYLE = 'width:100%;max-width:384px;border:1px solid #888;display:block;margin:0.3em 0'
# Pixels of the drawings of volume and residuals.
_WIDTH, _HEIGHT, _MARGIN = 400.0, 190.0, 34.0


def picture_svg(
    guide: CaptureGuide,
    proposal: Proposal | None,
    image: Image | None = None,
    corners: Corners | None = None,
) -> str:
    """
    Return the camera's picture with the fields that have seen corners, and the board as it goes.

    image, corners : the last picture, and what was detected in it; None for none
    """
    width, height = guide.size
    seen = {field for view in guide.views for field in view.fields}
    fields = ''.join(
        f'<rect x="{column * width / 3:.0f}" y="{row * height / 3:.0f}" '
        f'width="{width / 3:.0f}" height="{height / 3:.0f}" stroke="#888" '
        f'fill="{_SEEN if (row, column) in seen else "none"}" fill-opacity="0.3"/>'
        for row in range(3)
        for column in range(3)
    )
    found = 'no board detected' if corners is None else f'{len(corners)} corners detected'
    label = f'{found}; {guide.coverage:.0%} of the image covered'
    board = ''
    if proposal is not None:
        label += f'; next: {proposal.text}'
        board = (
            f'<polygon points="{_points(proposal.outline_uv * guide.size)}" fill="{_NEXT}" '
            f'fill-opacity="0.25" stroke="{_NEXT}" stroke-width="{width / 100:.0f}"/>'
        )
    dots = '' if corners is None else _dots(corners.uv, width / 110)
    back = '' if image is None else _background(image, width, height)
    return (
        f'<svg role="img" aria-label="{escape(label)}" viewBox="0 0 {width} {height}" '
        f'style="{_STYLE}">{back}{fields}{board}{dots}</svg>'
    )


def volume_svg(guide: CaptureGuide) -> str:
    """
    Return the boards of all pictures as seen from above the camera, which is on the left.

    Distances hold for a typical focal length: only their ratio is known before the calibration.
    """
    if not guide.views:
        return ''
    half = 0.5 * float(np.ptp(guide.board.corners_xyz[:, 0]))
    ends = np.array(
        [
            [_above(view.center, view.distance, view.normal, side * half) for side in (-1.0, 1.0)]
            for view in guide.views
        ]
    )
    far = float(ends[..., 0].max())
    scale = min(
        (_WIDTH - _MARGIN) / far,
        (0.5 * _HEIGHT - 8.0) / max(float(np.abs(ends[..., 1]).max()), 1e-9),
    )
    lines = ''.join(
        f'<path d="M{8 + z1 * scale:.1f} {0.5 * _HEIGHT + x1 * scale:.1f}'
        f'L{8 + z2 * scale:.1f} {0.5 * _HEIGHT + x2 * scale:.1f}" stroke="{_SEEN}" '
        'stroke-width="3" stroke-linecap="round"/>'
        for (z1, x1), (z2, x2) in ends
    )
    reach = 0.5 / TYPICAL_FOCAL * far * scale
    distances = [view.distance for view in guide.views]
    ratio = max(distances) / min(distances)
    text = f'boards from above; farthest and nearest differ {ratio:.2f} times'
    return (
        f'<svg role="img" aria-label="{text}" viewBox="0 0 {_WIDTH:.0f} {_HEIGHT:.0f}" '
        f'font-size="12" style="{_STYLE}"><path d="M8 {0.5 * _HEIGHT}'
        f'l{far * scale:.1f} {-reach:.1f}M8 {0.5 * _HEIGHT}l{far * scale:.1f} {reach:.1f}" '
        f'stroke="#888" stroke-dasharray="4 4"/>{lines}'
        f'<text x="8" y="14" fill="{_INK}">{text}</text></svg>'
    )


def residual_svg(result: CameraCalibration) -> str:
    """Return the rms of each view as bars, on a scale that ends at the largest."""
    count, highest = len(result.view_rms), float(result.view_rms.max())
    step, room = (_WIDTH - _MARGIN - 8.0) / count, _HEIGHT - 48.0
    floor = _HEIGHT - 24.0
    bars = ''.join(
        f'<rect x="{_MARGIN + k * step + 1:.1f}" y="{floor - room * rms / highest:.1f}" '
        f'width="{max(step - 2, 1):.1f}" height="{room * rms / highest:.1f}" fill="#0072b2"/>'
        for k, rms in enumerate(result.view_rms.tolist())
    )
    line = floor - room * result.rms / highest
    text = f'residuals: {result.rms:.3f} px rms; the worst picture {highest:.3f} px'
    return (
        f'<svg role="img" aria-label="{text}" viewBox="0 0 {_WIDTH:.0f} {_HEIGHT:.0f}" '
        f'font-size="12" style="{_STYLE}">{bars}'
        f'<path d="M{_MARGIN} {floor}H{_WIDTH - 8}" stroke="{_INK}"/>'
        f'<path d="M{_MARGIN} {line:.1f}H{_WIDTH - 8}" stroke="{_NEXT}"/>'
        f'<text x="8" y="14" fill="{_INK}">{text}</text>'
        f'<text x="2" y="{floor - room + 4:.0f}" fill="{_INK}">{highest:.3f}</text>'
        f'<text x="2" y="{floor:.0f}" fill="{_INK}">0 px</text>'
        f'<text x="{_MARGIN}" y="{_HEIGHT - 8:.0f}" fill="{_INK}">pictures 1 to {count}</text>'
        '</svg>'
    )


def _above(center: Floats, distance: float, normal: Floats, half: float) -> tuple[float, float]:
    """Return depth and side, meters, of a point of a board that is ``half`` beside its center."""
    across = np.array([-normal[2], normal[0]])
    length = float(np.linalg.norm(across))
    across = across / length if length > 0.0 else np.array([1.0, 0.0])
    side = (center[0] - 0.5) / TYPICAL_FOCAL * distance
    return distance + half * float(across[1]), side + half * float(across[0])


def _points(uv: Floats) -> str:
    return ' '.join(f'{u:.0f},{v:.0f}' for u, v in uv)


def _dots(uv: Floats, radius: float) -> str:
    return ''.join(
        f'<circle cx="{u:.0f}" cy="{v:.0f}" r="{radius:.1f}" fill="{_NOW}" stroke="#000"/>'
        for u, v in uv
    )


def _background(image: Image, width: int, height: int) -> str:
    small: Any = cv2.resize(
        image, (_SIDE, round(_SIDE * height / width)), interpolation=cv2.INTER_AREA
    )
    _, encoded = cv2.imencode('.jpg', small, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    data = base64.b64encode(encoded.tobytes()).decode('ascii')
    return (
        f'<image width="{width}" height="{height}" preserveAspectRatio="none" '
        f'href="data:image/jpeg;base64,{data}"/>'
    )
