# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Boards that are not flat.

A board of paper on cardboard or foam bends by a millimetre, which a camera calibration takes for
another focal length (0.5 % was seen) and a laser calibration for another plane. The bend is one
shape in all pictures, so the pictures determine it (Strobl & Hirzinger 2011).
"""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.calibration.boards import Board
from ivfmc_ros.model import Floats

_ITERATIONS = 6


@dataclass(frozen=True, eq=False, kw_only=True)
class Bend:
    """
    Height of a board: z = a x^2 + b x y + c y^2 about ``center``, frame of the board, metres.

    center : (2,) metres
    coefficients : (3,) a, b, c in 1/metre
    """

    center: Floats
    coefficients: Floats

    @classmethod
    def flat(cls, board: Board) -> 'Bend':
        """Return no bend, about the middle of the corners."""
        corners = board.corners_xyz[:, :2]
        center = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
        return cls(center=center, coefficients=np.zeros(3))

    @property
    def is_flat(self) -> bool:
        """Whether there is no bend."""
        return not self.coefficients.any()

    def basis(self, xy: Floats) -> Floats:
        """Return (n, 3): what each coefficient adds to the height at (n, 2) places."""
        x, y = (xy - self.center).T
        return np.stack([x * x, x * y, y * y], axis=1)

    def height(self, xy: Floats) -> Floats:
        """Return (n,) heights in metres at (n, 2) places on the board."""
        return np.asarray(self.basis(xy) @ self.coefficients)

    def corners_xyz(self, board: Board) -> Floats:
        """Return the (n, 3) corners of ``board`` on the bent surface, metres."""
        corners = board.corners_xyz.copy()
        corners[:, 2] = self.height(corners[:, :2])
        return corners

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

    def normals(self, xy: Floats) -> Floats:
        """Return the (n, 3) unit normals of the surface at (n, 2) places."""
        x, y = (xy - self.center).T
        a, b, c = self.coefficients
        normals = np.stack([-2 * a * x - b * y, -b * x - 2 * c * y, np.ones_like(x)], axis=1)
        return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))
