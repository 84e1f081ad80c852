# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Writes the pictures of docs/images from the simulation and from the result of ``make demo``.

Run it as ``make pictures``, after ``make demo``.
"""

from pathlib import Path
import sys

import cv2
import numpy as np

from ivfmc_ros.calibration.boards.board import parse_board
from ivfmc_ros.cell import transforms
from ivfmc_ros.model import Floats
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.boards.pictures import render_board
from ivfmc_ros.simulation.boards.pictures import Surroundings

ROOT = Path(__file__).resolve().parents[1]
IMAGES = ROOT / 'docs' / 'images'
SIZE = (640, 512)
BOARD = parse_board('chessboard:9x7:15mm')


def main() -> int:
    """Write all pictures; the exit code is 1 if the demo was not run."""
    IMAGES.mkdir(parents=True, exist_ok=True)
    cell = bench_cell()
    tilted = pose((0.55, -0.45, 0.1), (0.01, -0.005, 0.40))
    board = render_board(cell, BOARD, tilted)
    save('board-good', board)
    save('board-frontal', render_board(cell, BOARD, pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.42))))
    save('board-blurred', cv2.filter2D(board, -1, np.full((1, 25), 1 / 25)))
    bright = render_board(cell, BOARD, tilted, surroundings=Surroundings(level=600.0))
    save('board-overexposed', cv2.GaussianBlur(bright, (0, 0), 2.0))
    save('stripe-good', render_board(cell, BOARD, tilted, laser=0))
    deviation = ROOT / 'build' / 'demo' / 'deviation.png'
    if not deviation.exists():
        print(f'{deviation.relative_to(ROOT)}: not there; run `make demo` first', file=sys.stderr)
        return 1
    # fewer gray levels make a file of a third of the size
    picture = cv2.resize(cv2.imread(str(deviation)), None, fx=0.8, fy=0.8)
    levels = ((picture.astype(int) + 4) // 8 * 8).clip(0, 255).astype(np.uint8)
    cv2.imwrite(str(IMAGES / 'demo.png'), levels, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    return 0


def pose(rotation: tuple[float, float, float], center: tuple[float, float, float]) -> Floats:
    """Return the (4, 4) camera_from_board; rotation vector in radians, center in meters."""
    turn = np.asarray(cv2.Rodrigues(np.array(rotation))[0], dtype=np.float64)
    return transforms.rigid(turn, np.array(center) - turn @ BOARD.corners_xyz.mean(axis=0))


def save(name: str, image: np.ndarray) -> None:
    """Write a picture at the size of the documentation."""
    small = cv2.resize(image, SIZE, interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(IMAGES / f'{name}.png'), small)


if __name__ == '__main__':
    sys.exit(main())
