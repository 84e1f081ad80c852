# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Camera pictures with the stripe found in them, and a part of each enlarged."""

from typing import Any

import cv2
import numpy as np

from ivfmc_ros.inspection.reports.rendering import ColorImage
from ivfmc_ros.inspection.reports.rendering import write_text
from ivfmc_ros.model import Bytes
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Frame
from ivfmc_ros.model import Profile

# BGR; orange is no color of a stripe of a red, green or blue laser.
MARK_BGR = (0, 140, 255)
_FRAME_BGR = (255, 255, 255)
_MARK_RADIUS = 2
# Pixels of the camera to either side of the enlarged point, and how much they are enlarged.
_HALF = (14, 11)
_ENLARGED = 8
_MARGIN = 8


def overlay(frame: Frame, profile: Profile, width: int = 640) -> ColorImage:
    """
    Return a camera picture, BGR, ``width`` pixels wide, with the points found.

    The corner without stripe shows the middle of the stripe enlarged, each point at its
    sub-pixel position.
    """
    image = _color(frame)
    scale = width / image.shape[1]
    picture: Any = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    places = _scaled(profile.uv, scale)
    for column, row in np.round(places).astype(int).tolist():
        cv2.circle(picture, (column, row), _MARK_RADIUS, MARK_BGR, cv2.FILLED, cv2.LINE_AA)
    if len(profile):
        _insert_detail(picture, image, profile.uv, scale)
    label = f'image {frame.seq}, table {np.degrees(frame.angle):.2f} deg, {len(profile)} points'
    write_text(picture, label, (_MARGIN, 20))
    return np.asarray(picture, dtype=np.uint8)


def _color(frame: Frame) -> Bytes:
    image: Any = frame.image if frame.image.dtype == np.uint8 else frame.image // 257
    image = image.astype(np.uint8)
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image)


def _scaled(uv: Floats, scale: float) -> Floats:
    """Return pixels of a resized picture; (0, 0) is the center of the first pixel in both."""
    return np.asarray((uv + 0.5) * scale - 0.5)


def _insert_detail(picture: Any, image: Bytes, uv: Floats, scale: float) -> None:
    middle = uv[np.argsort(uv[:, 1])[len(uv) // 2]]
    height, width = image.shape[:2]
    if width <= 2 * _HALF[0] or height <= 2 * _HALF[1]:
        return
    column = int(np.clip(middle[0], _HALF[0], width - 1 - _HALF[0]))
    row = int(np.clip(middle[1], _HALF[1], height - 1 - _HALF[1]))
    first = np.array([column - _HALF[0], row - _HALF[1]])
    cut = image[first[1] : row + _HALF[1] + 1, first[0] : column + _HALF[0] + 1]
    detail: Any = cv2.resize(
        cut, None, fx=_ENLARGED, fy=_ENLARGED, interpolation=cv2.INTER_NEAREST
    )
    for x, y in np.round(_scaled(uv - first, _ENLARGED)).astype(int).tolist():
        cv2.circle(detail, (x, y), 3, MARK_BGR, cv2.FILLED, cv2.LINE_AA)
    write_text(detail, f'{_ENLARGED} times', (4, 14))
    rows, columns = detail.shape[:2]
    if picture.shape[0] < rows + 2 * _MARGIN or picture.shape[1] < columns + 2 * _MARGIN:
        return
    cv2.rectangle(detail, (0, 0), (columns - 1, rows - 1), _FRAME_BGR, 1)
    left = _MARGIN if (uv[:, 0].mean() + 0.5) * scale > picture.shape[1] / 2 else -_MARGIN
    start = left if left > 0 else picture.shape[1] - columns - _MARGIN
    picture[-rows - _MARGIN : -_MARGIN, start : start + columns] = detail
