# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rendered pictures of all kinds for the calibration of a cell, kept on disk by seed."""

from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from ivfmc_ros.calibration.boards.board import parse_board
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.boards.pictures import render_board
from ivfmc_ros.simulation.boards.pictures import render_platter
from ivfmc_ros.simulation.boards.pictures import render_platter_board
from ivfmc_ros.simulation.boards.pictures import scatter_poses
from ivfmc_ros.simulation.parts.loading import Platter

KEPT = Path(__file__).resolve().parents[2] / 'build' / 'bench' / 'calibration'
CHESSBOARD = parse_board('chessboard:17x12:8mm')
CHARUCO = parse_board('charuco:10x7:12mm:9mm:DICT_4X4_50')
# About as many pictures of each kind as the tutorial asks for at least.
CAMERA_VIEWS, LASER_VIEWS, TABLE_VIEWS, PLATTER_VIEWS = 20, 12, 12, 3
_PLATTER = Platter(radius=0.065)


class Picture(NamedTuple):
    """One picture to render: file, what is to be seen, its number, and the seed of its noise."""

    path: Path
    kind: str
    laser: int | None
    pose: object
    seed: int


def pictures_of(seed: int, folder: Path = KEPT) -> list[Picture]:
    """Return the pictures of a seed: boards, stripes on boards, board and stripe on platter."""
    cell, rng = bench_cell(), np.random.default_rng(seed)
    place, found = folder / str(seed), []

    def add(name: str, kind: str, laser: int | None, poses: list) -> None:
        for number, pose in enumerate(poses):
            noise = 1000 * seed + len(found)
            found.append(Picture(place / name / f'{number:02d}.png', kind, laser, pose, noise))

    add('board', 'board', None, scatter_poses(cell, CHESSBOARD, CAMERA_VIEWS, rng, tilt=1.0))
    turns = 2 * np.pi * np.arange(TABLE_VIEWS) / TABLE_VIEWS
    for number, laser in enumerate(cell.lasers):
        poses = scatter_poses(cell, CHESSBOARD, LASER_VIEWS, rng)
        add(f'board_{laser.name}', 'board', number, poses)
        add(f'platter_{laser.name}', 'platter', number, [None] * PLATTER_VIEWS)
    add('platter', 'turned', None, list(turns))
    return found


def render_picture(picture: Picture) -> None:
    """Have a picture on disk."""
    if picture.path.exists():
        return
    cell, rng = bench_cell(), np.random.default_rng(picture.seed)
    image = _image(cell, picture, rng)
    picture.path.parent.mkdir(parents=True, exist_ok=True)
    part = picture.path.with_suffix('.part.png')
    cv2.imwrite(str(part), image)
    part.rename(picture.path)


def _image(cell: Cell, picture: Picture, rng: np.random.Generator) -> np.ndarray:
    if picture.kind == 'platter':
        return render_platter(cell, _PLATTER, picture.laser, rng=rng)
    if picture.kind == 'turned':
        return render_platter_board(cell, CHARUCO, picture.pose, rng=rng)
    return render_board(cell, CHESSBOARD, picture.pose, picture.laser, rng=rng)
