# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import cv2
import numpy as np
import pytest

from ivfmc_ros.calibration.boards.board import parse_board
from ivfmc_ros.calibration.boards.views import find_views
from ivfmc_ros.errors import CalibrationError
from ivfmc_ros.errors import FileError
from ivfmc_ros.pictures import list_pictures
from ivfmc_ros.simulation.boards.pictures import render_board

from ..conftest import look_at
from ..conftest import pose_matrix


@pytest.fixture
def pictures(tmp_path, cell, board):
    pose = pose_matrix(look_at(20, 10, (0.0, 0.0, 0.4), board))
    cv2.imwrite(str(tmp_path / '1.png'), render_board(cell, board, pose))
    cv2.imwrite(str(tmp_path / '2.png'), np.full((512, 640), 80, np.uint8))
    return tmp_path


def test_views_are_found_and_missed_pictures_listed(board, pictures):
    steps = []
    views = find_views(board, list_pictures(pictures), progress=lambda *step: steps.append(step))
    assert [view.path.name for view in views.found] == ['1.png']
    assert [path.name for path in views.missed] == ['2.png']
    assert views.size == (640, 512)
    assert steps[-1] == ('board', 2, 2)


def test_picture_of_another_size_is_named(board, pictures):
    cv2.imwrite(str(pictures / '3.png'), np.zeros((100, 100), np.uint8))
    with pytest.raises(FileError, match=r'3\.png: the picture is 100 x 100, expected 640 x 512'):
        find_views(board, list_pictures(pictures))


@pytest.mark.parametrize(('printed', 'given'), [(':legacy', ''), ('', ':legacy')])
def test_charuco_board_of_the_other_pattern_is_named(cell, tmp_path, printed, given):
    text = 'charuco:8x6:14mm:10mm:DICT_4X4_50'
    board = parse_board(text + printed)
    pose = pose_matrix(look_at(20, 10, (0.0, 0.0, 0.4), board))
    cv2.imwrite(str(tmp_path / '1.png'), render_board(cell, board, pose))
    with pytest.raises(CalibrationError) as error:
        find_views(parse_board(text + given), list_pictures(tmp_path))
    assert str(error.value).endswith(f'1 of 1 pictures show {text}{printed}: use that')


def test_board_that_is_never_detected_is_named(board, pictures):
    (pictures / '1.png').unlink()
    with pytest.raises(CalibrationError, match=r'none of 1 pictures shows chessboard:9x7:14mm'):
        find_views(board, list_pictures(pictures))
