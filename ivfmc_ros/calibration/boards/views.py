# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of a board: which of them show it, and where."""

from collections.abc import Callable
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
import os
from pathlib import Path
from typing import TypeVar

import numpy as np

from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.calibration.boards.board import Corners
from ivfmc_ros.calibration.boards.board import find_corners
from ivfmc_ros.errors import CalibrationError
from ivfmc_ros.errors import FileError
from ivfmc_ros.model import Image
from ivfmc_ros.pictures import read_picture
from ivfmc_ros.progress import Progress
from ivfmc_ros.progress import silent

_Seen = TypeVar('_Seen')

# Fewer corners of a partial board, or corners in a line, do not determine its pose.
MIN_CORNERS = 8
_MIN_SPREAD = 0.05


@dataclass(frozen=True, eq=False, kw_only=True)
class View:
    """A picture that shows the board."""

    path: Path
    corners: Corners

    @property
    def name(self) -> str:
        """Folder and file: pictures of several folders may have the same file names."""
        return name_of(self.path)


def name_of(path: Path) -> str:
    """Return how a picture is named in reports."""
    return f'{path.parent.name}/{path.name}'


@dataclass(frozen=True, eq=False, kw_only=True)
class Views:
    """
    What the pictures of a folder show.

    size : (width, height) of every picture
    without : pictures on which the board was not found
    """

    found: tuple[View, ...]
    without: tuple[Path, ...]
    size: tuple[int, int]


def find_views(
    board: Board,
    pictures: Sequence[Path],
    size: tuple[int, int] | None = None,
    progress: Progress = silent,
    *,
    lit: bool = False,
) -> Views:
    """
    Look for ``board`` in pictures.

    size : (width, height) that every picture must have; None for that of the first
    lit : whether a stripe is on the board
    :raises FileError: a picture cannot be read or has another size
    :raises CalibrationError: no picture shows the board
    """
    size = size or picture_size(pictures[0])

    def look(path: Path) -> Corners | None:
        corners = find_corners(board, read_sized(path, size), lit=lit)
        return corners if corners is not None and _determines_pose(board, corners) else None

    seen = for_each_picture(look, pictures, 'board', progress)
    pairs = list(zip(pictures, seen, strict=True))
    found = tuple(View(path=path, corners=corners) for path, corners in pairs if corners)
    if not found:
        raise CalibrationError(
            f'{pictures[0].parent}: none of {len(pictures)} pictures shows {board}; '
            'check --board: kind, number of columns and rows'
        )
    without = tuple(path for path, corners in pairs if not corners)
    return Views(found=found, without=without, size=size)


def for_each_picture(
    look: Callable[[Path], _Seen], pictures: Sequence[Path], stage: str, progress: Progress
) -> list[_Seen]:
    """Call ``look`` on every picture, on all processors (OpenCV frees them while it works)."""
    results: list[_Seen] = []
    with ThreadPoolExecutor(os.cpu_count() or 1) as threads:
        try:
            for result in threads.map(look, pictures):
                results.append(result)
                progress(stage, len(results), len(pictures))
        except BaseException:
            threads.shutdown(cancel_futures=True)
            raise
    return results


def picture_size(path: Path) -> tuple[int, int]:
    """
    Return (width, height) of a picture.

    :raises FileError: it cannot be read
    """
    height, width = read_picture(path).shape[:2]
    return width, height


def read_sized(path: Path, size: tuple[int, int]) -> Image:
    """
    Read a picture that must be ``size`` (width, height).

    :raises FileError: it cannot be read or has another size
    """
    image = read_picture(path)
    if image.shape[1::-1] != size:
        raise FileError(
            f'{path}: the picture is {image.shape[1]} x {image.shape[0]}, expected '
            f'{size[0]} x {size[1]}; use pictures of one camera at one size'
        )
    return image


def _determines_pose(board: Board, corners: Corners) -> bool:
    if len(corners) < MIN_CORNERS:
        return False
    xy = board.corners_xyz[corners.ids, :2]
    spread = np.linalg.svd(xy - xy.mean(axis=0), compute_uv=False)
    return bool(spread[1] > _MIN_SPREAD * spread[0])
