# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Board detection in a set of pictures, in parallel; pictures without the board are listed."""

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
from ivfmc_ros.progress import no_progress
from ivfmc_ros.progress import Progress

_Result = TypeVar('_Result')

# Least number of corners for a pose of 6 parameters with residuals to judge it by.
MIN_CORNERS = 8
# Pictures in which the other ChArUco pattern is searched when a board is in none.
_TWIN_PICTURES = 4
# Least ratio of the two singular values of the corners: collinear ones leave the pose open.
_MIN_SPREAD = 0.05


@dataclass(frozen=True, eq=False, kw_only=True)
class BoardView:
    """A picture in which the board was detected."""

    path: Path
    corners: Corners

    @property
    def name(self) -> str:
        """Folder and file: pictures of several folders may have the same file names."""
        return picture_name(self.path)


def picture_name(path: Path) -> str:
    """Return the name of a picture in reports: folder and file."""
    return f'{path.parent.name}/{path.name}'


@dataclass(frozen=True, eq=False, kw_only=True)
class BoardViews:
    """
    Board detections in a set of pictures.

    found : pictures with the board
    missed : pictures in which the board was not detected
    size : (width, height) of every picture, pixels
    """

    found: tuple[BoardView, ...]
    missed: tuple[Path, ...]
    size: tuple[int, int]


def find_views(
    board: Board,
    pictures: Sequence[Path],
    size: tuple[int, int] | None = None,
    progress: Progress = no_progress,
    *,
    with_stripe: bool = False,
) -> BoardViews:
    """
    Detect ``board`` in pictures.

    size : (width, height) that every picture must have; None for that of the first
    with_stripe : whether the laser stripe is on the board
    :raises FileError: a picture cannot be read or has another size
    :raises CalibrationError: no picture shows the board
    """
    size = size or picture_size(pictures[0])

    def detect(path: Path) -> Corners | None:
        corners = find_corners(board, read_sized(path, size), with_stripe=with_stripe)
        return corners if corners is not None and constrains_pose(board, corners) else None

    corners_by_picture = for_each_picture(detect, pictures, 'board', progress)
    detections = list(zip(pictures, corners_by_picture, strict=True))
    found = tuple(BoardView(path=path, corners=corners) for path, corners in detections if corners)
    if not found:
        raise CalibrationError(
            f'{pictures[0].parent}: none of {len(pictures)} pictures shows {board}; '
            f'check --board: kind, number of columns and rows{_twin_text(board, pictures)}'
        )
    missed = tuple(path for path, corners in detections if not corners)
    return BoardViews(found=found, missed=missed, size=size)


def _twin_text(board: Board, pictures: Sequence[Path]) -> str:
    """Return that the board is seen as one of the other ChArUco pattern; '' if it is not."""
    twin = board.other_pattern()
    if twin is None:
        return ''
    chosen = pictures[:: max(1, len(pictures) // _TWIN_PICTURES)]
    seen = sum(find_corners(twin, read_picture(path)) is not None for path in chosen)
    return f'. {seen} of {len(chosen)} pictures show {twin}: use that' if seen else ''


def for_each_picture(
    process: Callable[[Path], _Result], pictures: Sequence[Path], stage: str, progress: Progress
) -> list[_Result]:
    """
    Call ``process`` for every picture, in one thread per processor; return the results in order.

    OpenCV releases the GIL, so that threads run in parallel.
    """
    results: list[_Result] = []
    with ThreadPoolExecutor(os.cpu_count() or 1) as threads:
        try:
            for result in threads.map(process, pictures):
                results.append(result)
                progress(stage, len(results), len(pictures))
        except BaseException:
            threads.shutdown(cancel_futures=True)
            raise
    return results


def picture_size(path: Path) -> tuple[int, int]:
    """
    Return (width, height) of a picture.

    :raises FileError: the picture cannot be read
    """
    height, width = read_picture(path).shape[:2]
    return width, height


def read_sized(path: Path, size: tuple[int, int]) -> Image:
    """
    Read a picture that must be ``size`` (width, height).

    :raises FileError: the picture cannot be read or has another size
    """
    image = read_picture(path)
    if image.shape[1::-1] != size:
        raise FileError(
            f'{path}: the picture is {image.shape[1]} x {image.shape[0]}, expected '
            f'{size[0]} x {size[1]}; use pictures of one camera at one size'
        )
    return image


def constrains_pose(board: Board, corners: Corners) -> bool:
    """Return whether the corners are enough, and not collinear, for the pose of the board."""
    if len(corners) < MIN_CORNERS:
        return False
    xy = board.corners_xyz[corners.ids, :2]
    spread = np.linalg.svd(xy - xy.mean(axis=0), compute_uv=False)
    return bool(spread[1] > _MIN_SPREAD * spread[0])
