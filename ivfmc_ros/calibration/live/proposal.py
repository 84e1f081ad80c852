# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The pose of the board that a set of pictures lacks most, to be drawn over the camera picture."""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.calibration.boards.board import Corners
from ivfmc_ros.calibration.live.guide import CaptureGuide
from ivfmc_ros.calibration.live.guide import DISTANCE
from ivfmc_ros.calibration.live.guide import PLACE
from ivfmc_ros.calibration.live.guide import TILT
from ivfmc_ros.calibration.live.guide import TYPICAL_FOCAL
from ivfmc_ros.model import Floats

# Radians, of a board that is to be tilted: as the text of the guide says.
_TILT = np.radians(30.0)
# Share of the image that the board takes: of a tilted one, and of one in a field of the image.
_TILTED_SHARE, _FIELD_SHARE = 0.55, 0.3
# Factors of the least distance so far, and of the greatest.
_NEARER, _FARTHER = 0.78, 1.3
# Steps of further pictures in place and tilt: the golden ratio spreads them evenly (Kronecker).
_GOLDEN = 0.618034
# Poses that are tried for a further picture.
_TRIALS = 60


@dataclass(frozen=True, eq=False, kw_only=True)
class Proposal:
    """
    Where the board goes next.

    text : what to do
    corners_uv : (n, 2) of the corners of the board, share of width and height of the image
    outline_uv : (4, 2) of its outermost corners, around the board
    """

    text: str
    corners_uv: Floats
    outline_uv: Floats


def propose(guide: CaptureGuide) -> Proposal | None:
    """Return the pose that the set lacks most; None for a complete set."""
    lacks = guide.lacks()
    if not lacks:
        return None
    kind, key, text = lacks[0]
    tilt, center, share = np.zeros(2), np.array([0.5, 0.5]), _TILTED_SHARE
    depth: float | None = None
    if kind == TILT:
        axis, sign = key
        tilt[axis] = sign * _TILT
    elif kind == PLACE:
        row, column = key
        center, share = (np.array([column, row]) + 0.5) / 3.0, _FIELD_SHARE
    elif kind == DISTANCE:
        distances = [view.distance for view in guide.views]
        if distances:
            is_nearer = len(distances) % 2 == 0
            depth = _NEARER * min(distances) if is_nearer else _FARTHER * max(distances)
    else:
        return _further(guide, text)
    return _posed(guide, text, tilt, center, share, depth)


def _further(guide: CaptureGuide, text: str) -> Proposal:
    """Return a pose that no picture has yet."""
    for number in range(len(guide.views), len(guide.views) + _TRIALS):
        steps = number * np.array([_GOLDEN, np.sqrt(2.0), np.sqrt(3.0), np.sqrt(5.0)]) % 1.0 - 0.5
        found = _posed(guide, text, _TILT * steps[:2], 0.5 + 0.5 * steps[2:], 0.45, None)
        corners = Corners(ids=np.arange(len(found.corners_uv)), uv=found.corners_uv * guide.size)
        if not guide.add(corners)[1]:
            break
    return found


def _posed(
    guide: CaptureGuide,
    text: str,
    tilt: Floats,
    center: Floats,
    share: float,
    depth: float | None,
) -> Proposal:
    """Project the board; ``depth`` is chosen so that it takes ``share`` of the image if None."""
    size = np.array(guide.size, dtype=np.float64)
    focal = TYPICAL_FOCAL * size[0]
    points = guide.board.corners_xyz - guide.board.corners_xyz.mean(axis=0)
    if depth is None:
        depth = float((focal * np.ptp(points[:, :2], axis=0) / (share * size)).max())
    # the side whose tilt is positive is nearer: right, or lower
    across = np.array([np.cos(tilt[0]), 0.0, -np.sin(tilt[0])])
    down = np.array([0.0, np.cos(tilt[1]), -np.sin(tilt[1])])
    down -= (down @ across) * across
    down /= np.linalg.norm(down)
    place = np.array([*((center - 0.5) * size * depth / focal), depth])
    posed = points[:, :1] * across + points[:, 1:2] * down + place
    uv = (posed[:, :2] / posed[:, 2:] * focal + size / 2) / size
    return Proposal(text=text, corners_uv=uv, outline_uv=uv[_outline(guide.board)])


def _outline(board: Board) -> list[int]:
    """Return the ids of the outermost corners, around the board."""
    x, y = board.corners_xyz[:, 0], board.corners_xyz[:, 1]
    return [int(np.argmax(a * x + b * y)) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
