# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import cv2
import numpy as np
import pytest

from ivfmc_ros.calibration.boards.board import parse_board
from ivfmc_ros.calibration.boards.markers import parse_markers
from ivfmc_ros.calibration.joint.sort_pictures import sort_pictures
from ivfmc_ros.errors import CalibrationError
from ivfmc_ros.pictures import list_picture_tree

BOARD = parse_board('chessboard:5x4:10mm')
TARGET = parse_markers('DICT_4X4_50:30mm')
SIZE = (240, 320)


def chessboard_picture():
    squares = np.add.outer(np.arange(5), np.arange(6)) % 2 * 255
    print_ = np.kron(squares, np.ones((30, 30))).astype(np.uint8)
    page = np.full(SIZE, 255, dtype=np.uint8)
    page[45:195, 60:240] = print_
    return page


def marker_picture():
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    page = np.full(SIZE, 255, dtype=np.uint8)
    page[60:160, 80:180] = cv2.aruco.generateImageMarker(dictionary, 7, 100)
    return page


@pytest.fixture
def folder(tmp_path):
    empty = np.full(SIZE, 90, dtype=np.uint8)
    for name, image in {
        'board/1.png': chessboard_picture(),
        'board/left_2.png': chessboard_picture(),
        'with right/3.png': chessboard_picture(),
        'platter/4.png': marker_picture(),
        'platter/left/5.png': marker_picture(),
        'bare_right/6.png': empty,
        'other/7.png': empty,
        # the board was not detected: no picture of the platter
        'with right/8.png': empty,
    }.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(tmp_path / name), image)
    return tmp_path


def names(paths):
    return [path.stem for path in paths]


def test_pictures_are_sorted_by_sight_and_by_name(folder):
    lasers = {'left': ('left',), 'right': ('RIGHT',)}
    found = sort_pictures(BOARD, TARGET, list_picture_tree([folder]), lasers)
    sets = found.sets
    assert names(view.path for view in sets.board.found) == ['1']
    assert names(view.path for view in sets.board_lasers['left'].found) == ['left_2']
    assert names(view.path for view in sets.board_lasers['right'].found) == ['3']
    assert sorted(names(sets.platter)) == ['4', '5']
    assert names(sets.platter_lasers['left']) == ['5']
    assert names(sets.platter_lasers['right']) == ['6']
    assert found.unknown['other/7.png'].endswith('no name of a laser')
    assert found.unknown['with right/8.png'].endswith('not detected')
    assert len(found.unknown) == 2


def test_name_of_two_lasers_is_refused(folder):
    lasers = {'left': ('left',), 'right': ('left', 'right')}
    with pytest.raises(CalibrationError, match=r'several lasers \(left, right\)'):
        sort_pictures(BOARD, TARGET, list_picture_tree([folder]), lasers)


def test_missing_kind_is_refused(folder):
    lasers = {'left': ('left',), 'blue': ('blue',)}
    with pytest.raises(CalibrationError, match='stripe of laser blue'):
        sort_pictures(BOARD, TARGET, list_picture_tree([folder]), lasers)
    with pytest.raises(CalibrationError, match='no picture shows DICT_5X5_50'):
        other = parse_markers('DICT_5X5_50:30mm')
        sort_pictures(BOARD, other, list_picture_tree([folder]), {'left': ('left',)})
