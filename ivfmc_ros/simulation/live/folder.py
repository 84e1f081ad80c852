# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The folder in which the processes of a simulated cell meet."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from ivfmc_ros import files
from ivfmc_ros.cell.camera_file import load_camera
from ivfmc_ros.cell.camera_file import save_camera
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.cell_file import load_cell
from ivfmc_ros.cell.cell_file import save_cell
from ivfmc_ros.errors import FileError
from ivfmc_ros.simulation.parts.loading import Solid
from ivfmc_ros.simulation.render.optics import Optics


@dataclass(frozen=True, eq=False, kw_only=True)
class LiveDescription:
    """What is to be seen: the cell, the part (None for none), light and sensor, the noise."""

    cell: Cell
    solid: Solid | None
    optics: Optics
    seed: int


class LiveFolder:
    """
    Names of what is in the folder.

    board : symbolic link to the serial port of the motion board
    truth : what table and lasers do, see live_truth
    faults : named pipe that takes faults of the board, one a line, see BoardEmulator.fault
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.board = folder / 'board'
        self.truth = folder / 'truth'
        self.faults = folder / 'faults'
        self._cell = folder / 'cell.yaml'
        self._camera = folder / 'camera.yaml'
        self._part = folder / 'part.npz'
        self._light = folder / 'light.yaml'

    def write(self, description: LiveDescription) -> None:
        """:raises FileError: the folder cannot be written."""
        save_cell(self._cell, description.cell)
        save_camera(self._camera, description.cell.camera)
        if description.solid is not None:
            with files.whole_file(self._part) as path, path.open('wb') as stream:
                np.savez(
                    stream,
                    vertices_xyz=description.solid.vertices_xyz,
                    faces=description.solid.faces,
                )
        light = {'seed': description.seed, 'optics': vars(description.optics)}
        files.write_text(self._light, yaml.safe_dump(light))

    def read(self) -> LiveDescription:
        """:raises FileError: there is no simulated cell in the folder."""
        camera = load_camera(self._camera)
        cell = load_cell(self._cell, camera)
        try:
            light = yaml.safe_load(self._light.read_text(encoding='utf-8'))
            optics, seed = Optics(**light['optics']), int(light['seed'])
            solid = self._read_part() if self._part.exists() else None
        except (OSError, ValueError, KeyError, TypeError, yaml.YAMLError) as error:
            raise FileError(f'{self.folder}: is no folder of a simulated cell: {error}') from error
        return LiveDescription(cell=cell, solid=solid, optics=optics, seed=seed)

    def clear(self) -> None:
        """Take away what only lives with the process of the cell, and what it wrote."""
        for path in (
            self.board,
            self.truth,
            self.faults,
            self._cell,
            self._camera,
            self._part,
            self._light,
        ):
            path.unlink(missing_ok=True)

    def _read_part(self) -> Solid:
        with np.load(self._part) as arrays:
            return Solid(vertices_xyz=arrays['vertices_xyz'], faces=arrays['faces'])
