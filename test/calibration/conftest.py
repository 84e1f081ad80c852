# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A small camera, a board, and detections with exact corners plus noise."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.calibration.boards.board import Corners
from ivfmc_ros.calibration.boards.board import parse_board
from ivfmc_ros.calibration.boards.views import BoardView
from ivfmc_ros.calibration.boards.views import BoardViews
from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.simulation.bench import bench_cell


def half_size(cell: Cell) -> Cell:
    """The bench cell with pixels of twice the size: its pictures are drawn four times as fast."""
    K = cell.camera.K / 2.0
    K[:2, 2] -= 0.25
    K[2, 2] = 1.0
    camera = Camera(width=640, height=512, K=K, distortion=cell.camera.distortion)
    return Cell(camera=camera, turntable=cell.turntable, lasers=cell.lasers)


def look_at(tilt_x: float, tilt_y: float, place: tuple[float, float, float], board: Board):
    """Pose (6,) of a board centered at ``place``, meters; tilts in degrees."""
    turn = cv2.Rodrigues(np.radians([tilt_x, tilt_y, 0.0]))[0]
    middle = board.corners_xyz.mean(axis=0)
    return np.concatenate([cv2.Rodrigues(turn)[0].ravel(), np.array(place) - turn @ middle])


def corners_at(camera: Camera, corners_xyz, pose, noise: float, rng) -> Corners:
    turn = cv2.Rodrigues(pose[:3])[0]
    uv = camera.project(corners_xyz @ turn.T + pose[3:])
    return Corners(ids=np.arange(len(uv)), uv=uv + noise * rng.standard_normal(uv.shape))


@pytest.fixture(scope='session')
def cell() -> Cell:
    return half_size(bench_cell())


@pytest.fixture(scope='session')
def board() -> Board:
    return parse_board('chessboard:9x7:14mm')


@pytest.fixture(scope='session')
def poses(board):
    """24 poses of the board, tilted in all directions, at several distances."""
    rng = np.random.default_rng(3)
    tilts = rng.uniform(15, 40, (24, 2)) * rng.choice([-1, 1], (24, 2))
    places = rng.uniform([-0.02, -0.02, 0.33], [0.02, 0.02, 0.47], (24, 3))
    return [look_at(*tilt, tuple(place), board) for tilt, place in zip(tilts, places, strict=True)]


@pytest.fixture
def make_views(cell, board, poses):
    """Detections with exact corners plus noise; ``corners_xyz`` replaces the nominal corners."""

    def make(noise: float = 0.03, corners_xyz=None, seed: int = 0) -> BoardViews:
        rng = np.random.default_rng(seed)
        points = board.corners_xyz if corners_xyz is None else corners_xyz
        found = tuple(
            BoardView(
                path=Path(f'pictures/{k}.png'),
                corners=corners_at(cell.camera, points, pose, noise, rng),
            )
            for k, pose in enumerate(poses)
        )
        return BoardViews(found=found, missed=(), size=cell.camera.size)

    return make


def pose_matrix(pose):
    return transforms.rigid(cv2.Rodrigues(pose[:3])[0], pose[3:])
