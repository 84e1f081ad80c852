# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of what was found in a shot: right, wrong, and rows left empty."""

from pathlib import Path

import cv2
import numpy as np

from bench.metal import pictures
from bench.metal.pictures import Shot
from bench.metal.scores import distances
from bench.metal.scores import LIMIT
from ivfmc_ros.model import Frame
from ivfmc_ros.model import Profile

_ENLARGED = 2
_MARGIN = 20  # pixels around the stripe
# BGR: the directly lit stripe where nothing was found; points within the limit, and beyond it.
_EMPTY, _RIGHT, _WRONG = (255, 160, 0), (0, 255, 0), (0, 0, 255)


def draw(shot: Shot, frame: Frame, profile: Profile, path: Path) -> None:
    """Write the picture of a shot, and beside it the same with the points found."""
    truth = pictures.truth(shot)
    # dim light is shown brighter
    gray = (255.0 * np.sqrt(frame.image / 255.0)).astype(np.uint8)
    large = cv2.resize(gray, None, fx=_ENLARGED, fy=_ENLARGED, interpolation=cv2.INTER_NEAREST)
    plain = cv2.cvtColor(large, cv2.COLOR_GRAY2BGR)
    marked = plain.copy()
    for uv in truth.uv:
        _dot(marked, uv, _EMPTY)
    off = distances(shot, profile.points_xyz) > LIMIT
    for uv, wrong in zip(profile.uv, off, strict=True):
        _dot(marked, uv, _WRONG if wrong else _RIGHT)
    first = np.maximum(truth.uv.min(axis=0).astype(int) - _MARGIN, 0) * _ENLARGED
    last = (truth.uv.max(axis=0).astype(int) + _MARGIN) * _ENLARGED
    window = slice(first[1], last[1]), slice(first[0], last[0])
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.hstack([plain[window], marked[window]]))


def _dot(picture: np.ndarray, uv: np.ndarray, color: tuple[int, int, int]) -> None:
    u, v = np.rint(_ENLARGED * uv + 0.5).astype(int)
    picture[max(v, 0) : v + 2, max(u, 0) : u + 2] = color
