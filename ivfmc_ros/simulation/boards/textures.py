# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Texture of a printed calibration board: albedo on a fine grid in the frame of the board."""

from dataclasses import dataclass
import math

import numpy as np

from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.calibration.boards.board import marker_dictionary
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Singles

# albedo of paper and ink
WHITE = 1.0
BLACK = 0.1


@dataclass(frozen=True, eq=False, kw_only=True)
class Texture:
    """
    Albedo of a plane z = 0 on a regular grid.

    albedo : (rows, columns) float32, 1 is white, 0 is transparent; rows along y, columns along x
    corner_xy : (2,) meters, outer corner of the first texel
    texel : meters, side of a texel
    """

    albedo: Singles
    corner_xy: Floats
    texel: float

    @property
    def outline_xy(self) -> Floats:
        """(4, 2) meters, the corners of the texture in order around it."""
        rows, columns = self.albedo.shape
        unit = np.array([[0, 0], [columns, 0], [columns, rows], [0, rows]])
        return np.asarray(self.corner_xy + unit * self.texel)


def board_texture(board: Board, texel: float, margin: float) -> Texture:
    """
    Return the print of a board with a white margin around it.

    texel : meters, greatest side of a texel
    margin : meters, rounded up to whole texels
    """
    per_square = _texels_per_square(board, texel)
    texel = board.square / per_square
    edge = math.ceil(margin / texel)
    print_ = _chessboard(board, per_square)
    if board.kind == 'charuco':
        print_ = _charuco(board, per_square)
    albedo = np.pad(print_, edge, constant_values=WHITE).astype(np.float32)
    # origin: first inner corner of a chessboard, outer corner of a ChArUco board
    first = -board.square if board.kind == 'chessboard' else 0.0
    corner = np.full(2, first - edge * texel)
    return Texture(albedo=albedo, corner_xy=corner, texel=texel)


def _texels_per_square(board: Board, texel: float) -> int:
    least = max(8, math.ceil(board.square / texel))
    if board.kind == 'chessboard':
        return least
    # choose the resolution at which the edges of the markers fall on texel borders
    return min(range(least, least + 64), key=lambda count: _marker_misfit(board, count))


def _marker_misfit(board: Board, per_square: int) -> float:
    size = per_square * (board.marker or 0.0) / board.square
    cells = marker_dictionary(board.dictionary or '').markerSize + 2
    gap = (per_square - size) / 2
    misfit = abs(gap - round(gap)) + abs(size / cells - round(size / cells))
    return float(round(misfit, 6) + 1e-7 * per_square)


def _chessboard(board: Board, per_square: int) -> Singles:
    # with black corners at one end only, OpenCV's SB detector counts from the other end
    first = (board.columns + board.rows) % 2
    parity = np.add.outer(np.arange(board.rows + 1), np.arange(board.columns + 1)) + first
    squares = np.where(parity % 2, WHITE, BLACK)
    return np.kron(squares, np.ones((per_square, per_square))).astype(np.float32)


def _charuco(board: Board, per_square: int) -> Singles:
    size = (board.columns * per_square, board.rows * per_square)
    drawn = board.charuco().generateImage(size, marginSize=0, borderBits=1)
    return np.asarray(BLACK + (WHITE - BLACK) * (drawn / 255.0), dtype=np.float32)
