# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.calibration.boards.board import find_corners
from ivfmc_ros.calibration.boards.board import parse_board
from ivfmc_ros.calibration.boards.board import parse_length
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.simulation.boards.pictures import render_board
from ivfmc_ros.simulation.render.optics import Optics

from ..conftest import look_at
from ..conftest import pose_matrix


@pytest.mark.parametrize(
    'text',
    [
        'chessboard:8x6:40mm',
        'charuco:10x7:12mm:9mm:DICT_4X4_50',
        'charuco:5x7:30mm:20mm:DICT_5X5_100:legacy',
    ],
)
def test_boards_are_written_as_they_are_read(text):
    assert str(parse_board(text)) == text


def test_chessboard_corners_run_along_columns_first():
    corners = parse_board('chessboard:8x6:0.04m').corners_xyz
    assert corners.shape == (48, 3)
    np.testing.assert_allclose(corners[1], [0.04, 0, 0])
    np.testing.assert_allclose(corners[8], [0, 0.04, 0])


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('chessboard', 'not understood'),
        ('chessboard:8x6', 'not understood'),
        ('chessboard:8:40mm', 'not understood'),
        ('chessboard:8x6:40', 'unit'),
        ('chessboard:8x6:0mm', 'unit'),
        ('chessboard:1x6:40mm', 'too small'),
        ('charuco:10x7:12mm:9mm', 'not understood'),
        ('charuco:10x7:12mm:19mm:DICT_4X4_50', 'smaller'),
        ('charuco:10x7:12mm:9mm:DICT_9X9', 'dictionary'),
        ('charuco:20x20:12mm:9mm:DICT_4X4_50', 'too few markers'),
        ('circles:8x6:40mm', 'not understood'),
    ],
)
def test_impossible_board_is_refused(text, message):
    with pytest.raises(ParameterError, match=message):
        parse_board(text)


def test_length_without_unit_is_refused():
    with pytest.raises(ParameterError, match='side'):
        parse_length('30', 'side')


@pytest.mark.parametrize('text', ['chessboard:9x7:14mm', 'charuco:10x7:12mm:9mm:DICT_4X4_50'])
def test_corners_are_found_to_a_tenth_of_a_pixel(cell, text):
    board = parse_board(text)
    pose = look_at(20, -25, (0.0, 0.0, 0.4), board)
    image = render_board(cell, board, pose_matrix(pose), optics=Optics(speckle=0.0))
    found = find_corners(board, image)
    turn = pose_matrix(pose)[:3, :3]
    true = cell.camera.project(board.corners_xyz @ turn.T + pose[3:])
    error = np.linalg.norm(found.uv - true[found.ids], axis=1)
    flipped = np.linalg.norm(found.uv - true[::-1][found.ids], axis=1)
    assert min(np.sqrt(np.mean(error**2)), np.sqrt(np.mean(flipped**2))) < 0.1
    assert len(found) > 0.9 * len(board.corners_xyz)


@pytest.mark.parametrize('bits', [10, 12, 16])
def test_board_is_found_whatever_bits_of_16_the_camera_sends(cell, board, bits):
    pose = look_at(20, -25, (0.0, 0.0, 0.4), board)
    image = render_board(cell, board, pose_matrix(pose), optics=Optics(speckle=0.0))
    low = (image.astype(np.uint16) * 257) >> (16 - bits)
    found, expected = find_corners(board, low), find_corners(board, image)
    assert np.array_equal(found.ids, expected.ids)
    assert np.abs(found.uv - expected.uv).max() < 0.1


def test_board_is_found_under_a_bright_stripe(cell, board):
    pose = look_at(5, -10, (0.0, 0.0, 0.4), board)
    image = render_board(cell, board, pose_matrix(pose), 0)
    assert find_corners(board, image, with_stripe=True) is not None


def test_no_board_is_found_in_noise(board):
    noise = np.random.default_rng(0).integers(0, 255, (480, 640), dtype=np.uint8)
    assert find_corners(board, noise) is None
