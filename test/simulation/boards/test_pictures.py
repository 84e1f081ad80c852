# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import cv2
import numpy as np
import pytest

from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.calibration.boards.board import find_corners
from ivfmc_ros.cell import transforms
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.simulation.boards.pictures import platter_board_pose
from ivfmc_ros.simulation.boards.pictures import render_board
from ivfmc_ros.simulation.boards.pictures import render_platter_board
from ivfmc_ros.simulation.boards.pictures import scatter_poses
from ivfmc_ros.simulation.boards.pictures import Surroundings
from ivfmc_ros.simulation.parts.loading import Platter
from ivfmc_ros.simulation.render.optics import Optics

CHESS = Board('chessboard', 9, 6, 0.01)
CHARUCO = Board('charuco', 10, 7, 0.012, 0.009, 'DICT_4X4_50')
QUIET = Optics().without_noise()


def pose(turn, place):
    rotation = cv2.Rodrigues(np.array(turn, dtype=float))[0]
    return transforms.rigid(rotation, np.array(place, dtype=float))


def edge_errors(picture, uv, axis):
    """Pixels between a dark-bright edge and the curve ``uv``, in lines along ``axis``."""
    along = 1 - axis
    lines = np.arange(np.ceil(uv[:, along].min()), uv[:, along].max()).astype(int)
    true = np.interp(lines, uv[:, along], uv[:, axis])
    window = np.round(true).astype(int)[:, None] + np.arange(-9, 10)
    values = picture[lines[:, None], window] if axis == 0 else picture[window, lines[:, None]]
    step = np.diff(values.astype(float), axis=1)
    return (step * (window[:, :-1] + 0.5)).sum(axis=1) / step.sum(axis=1) - true


@pytest.mark.parametrize('turn', [(0.0, 0.0, 0.05), (0.3, 0.4, 0.03), (0.2, -0.3, -0.1)])
@pytest.mark.parametrize('axis', [0, 1])
def test_edges_of_the_print_are_where_the_lens_sees_them(cell, turn, axis):
    board = Board('chessboard', 3, 3, 0.03)
    camera_from_board = pose(turn, (-0.031, -0.0293, 0.4))
    picture = render_board(cell, board, camera_from_board, optics=QUIET)
    edge = np.zeros((2000, 3))
    edge[:, axis], edge[:, 1 - axis] = 0.03, np.linspace(0.006, 0.024, 2000)
    uv = cell.camera.project(transforms.apply(camera_from_board, edge))
    errors = edge_errors(picture, uv, axis)
    assert abs(errors.mean()) < 0.003
    assert np.abs(errors).max() < 0.03


@pytest.mark.parametrize(('board', 'rms'), [(CHESS, 0.025), (CHARUCO, 0.08)])
def test_corners_are_found_where_they_are(cell, board, rms):
    for camera_from_board in scatter_poses(cell, board, 3, np.random.default_rng(1)):
        corners = find_corners(board, render_board(cell, board, camera_from_board, optics=QUIET))
        true = cell.camera.project(transforms.apply(camera_from_board, board.corners_xyz))
        errors = corners.uv - true[corners.ids]
        assert len(corners) == len(board.corners_xyz)
        # what is left is the detector's: a chessboard's by 0.01 px, markers disturb more
        assert np.abs(errors.mean(axis=0)).max() < 0.03
        assert np.sqrt((errors**2).mean()) < rms


@pytest.mark.parametrize('angle', [0.0, 2.0])
def test_board_turns_with_the_platter(cell, angle):
    board = Board('charuco', 8, 8, 0.015, 0.011, 'DICT_4X4_50')
    surroundings = Surroundings(platter=Platter())
    picture = render_platter_board(cell, board, angle, thickness=0.003, surroundings=surroundings)
    corners = find_corners(board, picture)
    assert corners is not None
    true = cell.turntable.to_camera(
        transforms.apply(
            transforms.invert(cell.turntable.camera_from_base)
            @ platter_board_pose(cell, board, 0.0, 0.003),
            board.corners_xyz,
        ),
        angle,
    )
    errors = corners.uv - cell.camera.project(true)[corners.ids]
    assert len(corners) > 40
    assert np.abs(np.median(errors, axis=0)).max() < 0.05


def test_board_on_the_platter_lies_at_its_thickness(cell):
    board_pose = platter_board_pose(cell, CHARUCO, 0.7, 0.003)
    corners = transforms.apply(board_pose, CHARUCO.corners_xyz)
    base = transforms.apply(transforms.invert(cell.turntable.camera_from_base), corners)
    assert base[:, 2] == pytest.approx(0.003)
    assert base[:, :2].mean(axis=0) == pytest.approx([0, 0], abs=1e-12)


@pytest.mark.parametrize('laser', [0, 1])
def test_stripe_on_a_board_triangulates_onto_it(cell, laser):
    board = Board('chessboard', 3, 3, 0.03)
    camera_from_board = pose((0.3, 0.1, 0.0), (-0.03, -0.03, 0.4))
    with_stripe, without = (
        render_board(
            cell, board, camera_from_board, on, optics=QUIET, surroundings=Surroundings(level=20.0)
        )
        for on in (laser, None)
    )
    light = with_stripe.astype(float) - without
    # rows inside of the white square below the middle: no edge of the print is near
    rows = np.flatnonzero(light.max(axis=1) > 100)[5:20]
    found = (light[rows] * np.arange(light.shape[1])).sum(axis=1) / light[rows].sum(axis=1)
    rays = cell.camera.rays(np.stack([found, rows], axis=1))
    points = cell.lasers[laser].intersect(rays)
    height = transforms.apply(transforms.invert(camera_from_board), points)[:, 2]
    assert np.abs(height).max() < 3e-5


def test_same_generator_gives_the_same_picture(cell):
    board_pose = pose((0.1, 0.2, 0.0), (-0.04, -0.03, 0.4))
    one, two, other = (
        render_board(cell, CHESS, board_pose, 0, rng=np.random.default_rng(seed))
        for seed in (5, 5, 6)
    )
    assert np.array_equal(one, two)
    assert not np.array_equal(one, other)


def test_chessboard_is_seen_from_any_end(cell):
    for columns, rows in ((9, 6), (8, 6), (7, 5)):
        board = Board('chessboard', columns, rows, 0.01)
        camera_from_board = pose((0.2, 0.1, 0.0), (-0.04, -0.03, 0.4))
        corners = find_corners(board, render_board(cell, board, camera_from_board))
        true = cell.camera.project(transforms.apply(camera_from_board, board.corners_xyz))
        off = [np.abs(corners.uv - order).max() for order in (true, true[::-1])]
        # where the print looks alike from both ends, either order is right
        assert min(off) < 0.3
        assert off[0] < 0.3 or (columns + rows) % 2 == 0


def test_board_out_of_the_picture_leaves_it_dark(cell):
    picture = render_board(cell, CHESS, pose((0, 0, 0), (0.5, 0.0, 0.4)), optics=QUIET)
    assert np.unique(picture).tolist() == [6]


def test_board_seen_from_behind_is_refused(cell):
    with pytest.raises(GeometryError, match='back of the board'):
        render_board(cell, CHESS, pose((np.pi, 0, 0), (0.0, 0.0, 0.4)))


def test_board_too_large_for_the_picture_is_refused(cell):
    with pytest.raises(GeometryError, match='does not fit'):
        scatter_poses(cell, Board('chessboard', 9, 6, 0.1), 1, np.random.default_rng(0))
