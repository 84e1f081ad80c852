# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Quality of one picture of a board: width of its edges, exposure, size."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.calibration.boards.board import Corners
from ivfmc_ros.calibration.boards.board import to_gray
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Image

# Pixels from 10 to 90 % of an edge: a sharp lens gives 1.5 to 2.5; from here corners are worse.
_MAX_EDGE_WIDTH = 4.0
# Share of the paper that may be saturated: whites that bloom move the corners.
_MAX_SATURATED = 0.02
_SATURATED = 250  # gray value (DN)
_MIN_PAPER = 70.0  # DN: darker paper has too little contrast for sub-pixel corners
_PAPER_PERCENTILE = 85.0  # of the gray values of the board: half of a chessboard is white
_MIN_SQUARE = 10.0  # pixels, side of a square
_PROFILE_HALF = 6  # pixels sampled to both sides of an edge
_MAX_PROFILES = 60


@dataclass(frozen=True, kw_only=True)
class PictureQuality:
    """
    What was measured in a picture of a board.

    edge_width : pixels from 10 to 90 % of the edges between squares (median)
    saturated : share of the board's pixels that are saturated
    paper : gray value of white paper, DN
    square : pixels, side of a square
    """

    edge_width: float
    saturated: float
    paper: float
    square: float

    def faults(self) -> tuple[str, ...]:
        """Return what makes the picture unusable, with the remedy; empty for a good one."""
        found = []
        if self.edge_width > _MAX_EDGE_WIDTH:
            found.append(
                f'blurred: edges are {self.edge_width:.1f} px wide, at most '
                f'{_MAX_EDGE_WIDTH:.0f}; hold the board still, focus, or expose for less time'
            )
        if self.saturated > _MAX_SATURATED:
            found.append(
                f'overexposed: {self.saturated:.0%} of the board is saturated; expose for less '
                'time or dim the light'
            )
        if self.paper < _MIN_PAPER:
            found.append(
                f'too dark: the paper has {self.paper:.0f} of 255; expose for longer or add light'
            )
        if self.square < _MIN_SQUARE:
            found.append(
                f'too small: a square has {self.square:.0f} px, at least {_MIN_SQUARE:.0f}; '
                'come nearer'
            )
        return tuple(found)


def picture_quality(board: Board, corners: Corners, image: Image) -> PictureQuality:
    """Measure the quality of a picture in which the corners of ``board`` were found."""
    gray = to_gray(image)
    hull = cv2.convexHull(corners.uv.astype(np.float32)).round().astype(np.int32)
    mask = np.zeros(gray.shape, dtype=np.uint8)
    cv2.fillPoly(mask, [hull], (1,))
    inside = gray[mask > 0]
    ends = _edges(board, corners)
    return PictureQuality(
        edge_width=_edge_width(gray, ends),
        saturated=float(np.mean(inside >= _SATURATED)) if len(inside) else 0.0,
        paper=float(np.percentile(inside, _PAPER_PERCENTILE)) if len(inside) else 0.0,
        square=float(np.median(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1))),
    )


def _edges(board: Board, corners: Corners) -> Floats:
    """Return (n, 2, 2) pixels: both ends of the edges between neighboring corners."""
    xy = np.round(board.corners_xyz[corners.ids, :2] / board.square).astype(int)
    place = {(int(x), int(y)): uv for (x, y), uv in zip(xy, corners.uv, strict=True)}
    pairs = [
        (uv, place[x + dx, y + dy])
        for (x, y), uv in place.items()
        for dx, dy in ((1, 0), (0, 1))
        if (x + dx, y + dy) in place
    ]
    return np.array(pairs).reshape(-1, 2, 2)


def _edge_width(gray: NDArray[np.uint8], ends: Floats) -> float:
    """Return the median width in pixels of the edges, 10 to 90 %, at their middles."""
    widths = []
    for a, b in ends[:: max(1, len(ends) // _MAX_PROFILES)]:
        along = b - a
        length = float(np.linalg.norm(along))
        if length < 4.0:
            continue
        across = np.array([along[1], -along[0]]) / length
        half = min(_PROFILE_HALF, 0.4 * length)
        steps = np.arange(-half, half + 0.01, 0.25)
        line = 0.5 * (a + b) + steps[:, None] * across
        map_u, map_v = (line[None, :, k].astype(np.float32) for k in (0, 1))
        profile = cv2.remap(gray, map_u, map_v, cv2.INTER_LINEAR)[0].astype(np.float64)
        widths.append(_transition(profile) * 0.25)
    return float(np.median(widths)) if widths else float('inf')


def _transition(profile: Floats) -> float:
    """Return the samples between 10 and 90 % of a step."""
    low, high = np.percentile(profile, [5, 95])
    if high - low < 10.0:
        return float('inf')
    share = (profile - low) / (high - low)
    return float(np.count_nonzero((share > 0.1) & (share < 0.9)))
