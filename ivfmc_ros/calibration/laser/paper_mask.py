# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Mask of the white paper of a calibration board, in the frame of the board."""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.calibration.boards.board import Corners
from ivfmc_ros.calibration.boards.board import to_gray
from ivfmc_ros.calibration.boards.edges import sample_bilinear
from ivfmc_ros.calibration.camera.board_poses import BoardPose
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Image

_TEXELS_PER_SQUARE = 40  # resolution of the mask


@dataclass(frozen=True, eq=False, kw_only=True)
class PaperMask:
    """
    Where a board is white.

    white : (h, w) bool
    corner : (2,) meters, outer corner of the first texel, frame of the board
    texel : meters, side of a texel
    """

    white: Bools
    corner: Floats
    texel: float

    def is_white(self, xy: Floats) -> Bools:
        """Return (n,) bool: white at (n, 2) meters; the border around the print is white."""
        index = np.floor((xy - self.corner) / self.texel).astype(np.int64)
        height, width = self.white.shape
        inside = (index >= 0).all(axis=1) & (index[:, 0] < width) & (index[:, 1] < height)
        white = np.ones(len(xy), dtype=bool)
        white[inside] = self.white[index[inside, 1], index[inside, 0]]
        return white


def paper_mask(
    board: Board, board_pose: BoardPose, corners: Corners, camera: Camera, image: Image
) -> PaperMask:
    """Return the mask of ``board``; the white squares of a chessboard are found in ``image``."""
    texel = board.square / _TEXELS_PER_SQUARE
    if board.kind == 'charuco':
        size = (board.columns * _TEXELS_PER_SQUARE, board.rows * _TEXELS_PER_SQUARE)
        print_ = board.charuco().generateImage(size, marginSize=0)
        return PaperMask(white=print_ > 127, corner=np.zeros(2), texel=texel)
    parity = np.add.outer(np.arange(board.rows + 1), np.arange(board.columns + 1)) % 2
    even_is_white = _even_is_brighter(board, board_pose, camera, to_gray(image))
    white = parity == (0 if even_is_white else 1)
    white = np.kron(white, np.ones((_TEXELS_PER_SQUARE, _TEXELS_PER_SQUARE), dtype=bool))
    return PaperMask(white=white, corner=np.full(2, -board.square), texel=texel)


def _even_is_brighter(board: Board, board_pose: BoardPose, camera: Camera, gray: Image) -> bool:
    """Return whether the squares of even column plus row are the white ones."""
    rows, columns = np.mgrid[: board.rows - 1, : board.columns - 1].reshape(2, -1)
    centers = np.zeros((len(rows), 3))
    centers[:, :2] = (np.stack([columns, rows], axis=1) + 0.5) * board.square
    uv = camera.project(board_pose.to_camera(centers))
    levels = sample_bilinear(gray, uv[:, None]).ravel()
    # square (0, 0) between the corners is square (1, 1) of the print: same parity
    even = (rows + columns) % 2 == 0
    return bool(np.median(levels[even]) > np.median(levels[~even]))
