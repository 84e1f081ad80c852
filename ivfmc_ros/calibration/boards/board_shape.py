# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Parametric shape of a calibration board: quadratic bend and anisotropic print scale.

A board of paper on cardboard or foam bends by about 1 mm, which biases the focal length of a
camera calibration (0.5 % was measured) and the plane of a laser calibration. The shape is the
same in all pictures, so the pictures determine it (Strobl & Hirzinger 2011, "More accurate
pinhole camera calibration with imperfect planar target"). Printers feed paper 0.1 to 0.3 % too
far or too short, which would otherwise appear as pixels that are not square.
"""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.model import Floats

# Fixed-point iterations of a ray with the bent surface; each gains about two digits.
_ITERATIONS = 6


@dataclass(frozen=True, eq=False, kw_only=True)
class BoardShape:
    """
    Deviation of a board from its nominal shape, about ``center`` in the frame of the board.

    The height is z = a x^2 + b x y + c y^2. The squares are longer along y than along x by the
    fraction e; the mean of both directions is the nominal length.

    center : (2,) meters
    coefficients : (4,) a, b, c in 1/meter, and e
    """

    center: Floats
    coefficients: Floats

    @classmethod
    def flat(cls, board: Board) -> 'BoardShape':
        """Return the flat, nominal shape, centered on the corners of ``board``."""
        corners = board.corners_xyz[:, :2]
        center = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
        return cls(center=center, coefficients=np.zeros(4))

    @property
    def is_flat(self) -> bool:
        """Whether the bend is zero."""
        return not self.coefficients[:3].any()

    @property
    def stretch(self) -> float:
        """Fraction by which the squares are longer along y than along x."""
        return float(self.coefficients[3])

    def jacobian(self, xy: Floats) -> Floats:
        """Return (n, 3, 4): derivative of points at nominal (n, 2) meters by the coefficients."""
        x, y = (xy - self.center).T
        moves = np.zeros((len(xy), 3, 4))
        moves[:, 2, :3] = np.stack([x * x, x * y, y * y], axis=1)
        moves[:, 0, 3], moves[:, 1, 3] = -0.5 * x, 0.5 * y
        return moves

    def height(self, xy: Floats) -> Floats:
        """Return (n,) heights in meters at (n, 2) meters on the board."""
        return np.asarray(self.jacobian(xy)[:, 2] @ self.coefficients)

    def corners_xyz(self, board: Board) -> Floats:
        """Return the (n, 3) corners of ``board`` with this shape, meters, frame of the board."""
        corners = board.corners_xyz
        return np.asarray(corners + self.jacobian(corners[:, :2]) @ self.coefficients)

    def sag(self, board: Board) -> float:
        """Return the range in meters of the bent corners about their mean plane."""
        corners = self.corners_xyz(board)
        design = np.column_stack([corners[:, :2], np.ones(len(corners))])
        fitted = design @ np.linalg.lstsq(design, corners[:, 2], rcond=None)[0]
        return float(np.ptp(corners[:, 2] - fitted))

    def intersect(self, origin: Floats, directions: Floats) -> Floats:
        """
        Return the intersections of lines with the board.

        origin : (3,) meters, frame of the board
        directions : (n, 3), not parallel to z = 0
        returns : (n, 3) meters
        """
        height = np.zeros(len(directions))
        for _ in range(_ITERATIONS):
            points = origin + directions * ((height - origin[2]) / directions[:, 2])[:, None]
            if self.is_flat:
                break
            height = self.height(points[:, :2])
        return np.asarray(points)
