# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np

from ivfmc_ros.calibration.boards.board import parse_board
from ivfmc_ros.calibration.boards.board_shape import BoardShape

BOARD = parse_board('chessboard:8x6:40mm')


def test_flat_board_has_its_nominal_corners():
    np.testing.assert_array_equal(BoardShape.flat(BOARD).corners_xyz(BOARD), BOARD.corners_xyz)


def test_sag_is_the_range_about_the_mean_plane():
    flat = BoardShape.flat(BOARD)
    bent = BoardShape(center=flat.center, coefficients=np.array([0.0, 0.0, 0.1, 0.0]))
    # 0.1 / m over 200 mm: 0 in the middle row places, 1 mm at the edges
    assert abs(bent.sag(BOARD) - 0.1 * (0.1**2 - 0.02**2)) < 1e-9


def test_stretch_keeps_the_mean_square():
    flat = BoardShape.flat(BOARD)
    corners = BoardShape(center=flat.center, coefficients=np.array([0, 0, 0, 0.01])).corners_xyz(
        BOARD
    )
    x, y = np.ptp(corners[:, 0]), np.ptp(corners[:, 1])
    np.testing.assert_allclose([x, y], [0.28 * 0.995, 0.20 * 1.005])


def test_lines_meet_the_bent_surface():
    bent = BoardShape(center=np.array([0.1, 0.1]), coefficients=np.array([0.5, 0.1, -0.3, 0.0]))
    origin = np.array([0.05, 0.02, -0.6])
    directions = np.array([[0.1, 0.1, 1.0], [-0.1, 0.2, 1.0], [0.0, 0.0, 1.0]])
    points = bent.intersect(origin, directions)
    np.testing.assert_allclose(points[:, 2], bent.height(points[:, :2]), atol=1e-10)
    np.testing.assert_allclose(np.cross(points - origin, directions), 0.0, atol=1e-12)
