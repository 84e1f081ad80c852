# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which places of a board are white paper."""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.calibration.boards.board import Corners
from ivfmc_ros.calibration.boards.board import to_gray
from ivfmc_ros.calibration.boards.edges import sample
from ivfmc_ros.calibration.camera.board_poses import Placed
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Image

_TEXELS_PER_SQUARE = 40


@dataclass(frozen=True, eq=False, kw_only=True)
class Paper:
    """
    The print of a board as a picture.

    white : (h, w) bool
    corner : (2,) metres, of the picture's first texel, frame of the board
    texel : metres
    """

    white: Bools
    corner: Floats
    texel: float

    def is_white(self, xy: Floats) -> Bools:
        """Tell of (n, 2) places in metres which are white; the border around the print is."""
        index = np.floor((xy - self.corner) / self.texel).astype(np.int64)
        height, width = self.white.shape
        inside = (index >= 0).all(axis=1) & (index[:, 0] < width) & (index[:, 1] < height)
        white = np.ones(len(xy), dtype=bool)
        white[inside] = self.white[index[inside, 1], index[inside, 0]]
        return white


def paper_of(
    board: Board, placed: Placed, corners: Corners, camera: Camera, image: Image
) -> Paper:
    """Return where ``board`` is white; which squares of a chessboard are is read in ``image``."""
    texel = board.square / _TEXELS_PER_SQUARE
    if board.kind == 'charuco':
        size = (board.columns * _TEXELS_PER_SQUARE, board.rows * _TEXELS_PER_SQUARE)
        print_ = board.charuco().generateImage(size, marginSize=0)
        return Paper(white=print_ > 127, corner=np.zeros(2), texel=texel)
    parity = np.add.outer(np.arange(board.rows + 1), np.arange(board.columns + 1)) % 2
    even_is_white = _even_is_brighter(board, placed, camera, to_gray(image))
    white = parity == (0 if even_is_white else 1)
    white = np.kron(white, np.ones((_TEXELS_PER_SQUARE, _TEXELS_PER_SQUARE), dtype=bool))
    return Paper(white=white, corner=np.full(2, -board.square), texel=texel)


def _even_is_brighter(board: Board, placed: Placed, camera: Camera, gray: Image) -> bool:
    """Tell whether the squares of even column plus row are the white ones."""
    rows, columns = np.mgrid[: board.rows - 1, : board.columns - 1].reshape(2, -1)
    centers = np.zeros((len(rows), 3))
    centers[:, :2] = (np.stack([columns, rows], axis=1) + 0.5) * board.square
    uv = camera.project(placed.to_camera(centers))
    levels = sample(gray, uv[:, None]).ravel()
    # square (0, 0) between the corners is square (1, 1) of the print: the parity is the same
    even = (rows + columns) % 2 == 0
    return bool(np.median(levels[even]) > np.median(levels[~even]))
