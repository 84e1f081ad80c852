# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Boards that are not flat, or printed longer one way than the other.

A board of paper on cardboard or foam bends by a millimetre, which a camera calibration takes for
another focal length (0.5 % was seen) and a laser calibration for another plane. The bend is one
shape in all pictures, so the pictures determine it (Strobl & Hirzinger 2011). Printers feed paper
0.1 to 0.3 % too far or too short, which a camera calibration takes for pixels that are not square.
"""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.model import Floats

_ITERATIONS = 6


@dataclass(frozen=True, eq=False, kw_only=True)
class Bend:
    """
    Shape of a board, about ``center`` in the frame of the board, metres.

    Its height is z = a x^2 + b x y + c y^2; its squares are longer along y by the share e, and
    what they are said to be in the mean of both directions.

    center : (2,) metres
    coefficients : (4,) a, b, c in 1/metre, and e
    """

    center: Floats
    coefficients: Floats

    @classmethod
    def flat(cls, board: Board) -> 'Bend':
        """Return no bend, about the middle of the corners."""
        corners = board.corners_xyz[:, :2]
        center = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
        return cls(center=center, coefficients=np.zeros(4))

    @property
    def is_flat(self) -> bool:
        """Whether there is no bend."""
        return not self.coefficients[:3].any()

    @property
    def stretch(self) -> float:
        """By which share the squares are longer along y than along x."""
        return float(self.coefficients[3])

    def derivatives(self, xy: Floats) -> Floats:
        """Return (n, 3, 4): how a corner at (n, 2) nominal places moves with each coefficient."""
        x, y = (xy - self.center).T
        moves = np.zeros((len(xy), 3, 4))
        moves[:, 2, :3] = np.stack([x * x, x * y, y * y], axis=1)
        moves[:, 0, 3], moves[:, 1, 3] = -0.5 * x, 0.5 * y
        return moves

    def height(self, xy: Floats) -> Floats:
        """Return (n,) heights in metres at (n, 2) places on the board."""
        return np.asarray(self.derivatives(xy)[:, 2] @ self.coefficients)

    def corners_xyz(self, board: Board) -> Floats:
        """Return the (n, 3) corners of ``board`` where they really are, metres."""
        corners = board.corners_xyz
        return np.asarray(corners + self.derivatives(corners[:, :2]) @ self.coefficients)

    def sag(self, board: Board) -> float:
        """Return the range in metres of the bent corners about their mean plane."""
        corners = self.corners_xyz(board)
        design = np.column_stack([corners[:, :2], np.ones(len(corners))])
        fitted = design @ np.linalg.lstsq(design, corners[:, 2], rcond=None)[0]
        return float(np.ptp(corners[:, 2] - fitted))

    def intersect(self, origin: Floats, directions: Floats) -> Floats:
        """
        Return where lines meet the board.

        origin : (3,) and directions : (n, 3), frame of the board; the lines cross z = 0
        returns : (n, 3) metres
        """
        height = np.zeros(len(directions))
        for _ in range(_ITERATIONS):
            points = origin + directions * ((height - origin[2]) / directions[:, 2])[:, None]
            if self.is_flat:
                break
            height = self.height(points[:, :2])
        return np.asarray(points)
