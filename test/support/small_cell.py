# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The bench cell with an image of half the width and height.

Its images are simulated four times faster: for what needs live cells, not their accuracy.
"""

from dataclasses import replace
from pathlib import Path

from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.cell.camera_file import save_camera
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.cell_file import save_cell
from ivfmc_ros.simulation.bench import bench_cell


def small_cell() -> Cell:
    """Return the cell with its pixels binned two by two."""
    cell = bench_cell()
    return replace(cell, camera=_binned(cell.camera))


def small_cell_options(folder: Path) -> list[str]:
    """Write the cell's files and return the options of ``ivfmc up`` that simulate it."""
    folder.mkdir(parents=True, exist_ok=True)
    cell = small_cell()
    paths = {'--cell': folder / 'small_cell.yaml', '--camera': folder / 'small_camera.yaml'}
    save_cell(paths['--cell'], cell)
    save_camera(paths['--camera'], cell.camera)
    return ['--simulate', *(str(word) for pair in paths.items() for word in pair)]


def _binned(camera: Camera) -> Camera:
    K = camera.K.copy()
    # the center of the first pixel is 0, also of a binned one
    K[:2, 2] += 0.5
    K[:2] /= 2
    K[:2, 2] -= 0.5
    return replace(camera, width=camera.width // 2, height=camera.height // 2, K=K)
