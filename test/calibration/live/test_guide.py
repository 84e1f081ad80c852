# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import cv2
import numpy as np
import pytest

from ivfmc_ros.calibration.boards.board import Corners
from ivfmc_ros.calibration.boards.board import parse_board
from ivfmc_ros.calibration.live.guide import CaptureGuide
from ivfmc_ros.calibration.live.picture import picture_quality

BOARD = parse_board('chessboard:9x7:14mm')
SIZE = (640, 480)
K = np.array([[960.0, 0.0, 320.0], [0.0, 960.0, 240.0], [0.0, 0.0, 1.0]])


def corners_at(tilt_x=0.0, tilt_y=0.0, place=(0.0, 0.0, 0.5)):
    """Corners of a board whose center is at ``place``, meters; tilts in degrees."""
    turn = cv2.Rodrigues(np.radians([tilt_x, tilt_y, 0.0]))[0]
    shift = np.array(place) - turn @ BOARD.corners_xyz.mean(axis=0)
    points = BOARD.corners_xyz @ turn.T + shift
    uv = points[:, :2] / points[:, 2:] @ K[:2, :2] + K[:2, 2]
    return Corners(ids=np.arange(len(uv)), uv=uv)


def complete_set():
    tilts = [(30, 0), (-30, 0), (0, 30), (0, -30), (15, 10)]
    places = [(x, y) for x in (-0.1, 0.0, 0.1) for y in (-0.07, 0.0, 0.07)]
    for number in range(45):
        x, y = places[number % 9]
        depth = (0.4, 0.6)[number % 2]
        yield corners_at(*tilts[number % 5], (x * depth / 0.5, y * depth / 0.5, depth))


def test_complete_set_lacks_nothing():
    guide = CaptureGuide(BOARD, SIZE)
    assert guide.missing()
    for corners in complete_set():
        guide, _ = guide.add(corners)
    assert guide.is_complete, guide.missing()
    assert guide.coverage == 1.0


def test_frontal_set_lacks_tilts():
    guide = CaptureGuide(BOARD, SIZE)
    for depth in np.linspace(0.35, 0.8, 30):
        guide, _ = guide.add(corners_at(place=(0.0, 0.0, depth)))
    assert not guide.is_complete
    assert sum('tilt the board' in text for text in guide.missing()) == 4


@pytest.mark.parametrize(
    ('tilt', 'side'), [((0, 30), 'right'), ((0, -30), 'left'), ((30, 0), 'upper')]
)
def test_tilt_is_told_by_the_side_that_is_nearer(tilt, side):
    corners = corners_at(*tilt)
    guide, _ = CaptureGuide(BOARD, SIZE).add(corners)
    missing = [text for text in guide.missing() if 'tilt' in text]
    assert len(missing) == 3
    assert not any(f'its {side} side towards' in text for text in missing), missing


def test_place_of_the_image_is_named():
    guide = CaptureGuide(BOARD, SIZE)
    for number, corners in enumerate(complete_set()):
        if number % 9 < 3:
            guide, _ = guide.add(corners)
    assert any('right of the image' in text for text in guide.missing())


def test_same_pose_adds_nothing():
    guide, reason = CaptureGuide(BOARD, SIZE).add(corners_at(20, 0))
    assert reason == ''
    again, reason = guide.add(corners_at(20.5, 0))
    assert 'as in another picture' in reason
    assert len(again.views) == 1


def picture(blur=0.0, gain=1.0):
    squares = np.add.outer(np.arange(8), np.arange(10)) % 2
    page = np.kron(np.where(squares, 200.0, 30.0), np.ones((40, 40)))
    page = np.pad(page, 40, constant_values=200.0)
    page = cv2.GaussianBlur(page, (0, 0), max(blur, 0.7))
    return np.clip(page * gain, 0, 255).astype(np.uint8)


def quality(**how):
    x, y = np.meshgrid(np.arange(1, 10) * 40 + 39.5, np.arange(1, 8) * 40 + 39.5)
    uv = np.stack([x.ravel(), y.ravel()], axis=1)
    return picture_quality(BOARD, Corners(ids=np.arange(63), uv=uv), picture(**how))


def test_good_picture_has_no_faults():
    found = quality()
    assert found.faults() == ()
    assert 1.0 < found.edge_width < 3.0
    assert found.square == pytest.approx(40.0)


@pytest.mark.parametrize(
    ('how', 'text'),
    [
        ({'blur': 4.0}, 'blurred'),
        ({'gain': 1.4}, 'overexposed'),
        ({'gain': 0.2}, 'too dark'),
    ],
)
def test_bad_picture_is_refused_by_name(how, text):
    assert any(fault.startswith(text) for fault in quality(**how).faults())
