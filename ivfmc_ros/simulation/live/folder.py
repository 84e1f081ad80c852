# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Folder through which the processes of a simulated cell exchange its description and state."""

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
    """
    What the camera of a simulated cell sees.

    cell : calibrated cell without errors
    solid : the part on the table, None for none
    optics : light and sensor
    seed : of the image noise
    """

    cell: Cell
    solid: Solid | None
    optics: Optics
    seed: int


class LiveFolder:
    """
    Files of the folder.

    controller : symbolic link to the serial port of the motion controller
    truth : true motion of the table and power of the lasers, see TruthWriter
    faults : named pipe for faults of the controller, one per line, see ControllerEmulator.fault
    camera_fault : file with the present fault of the camera, ``unplug`` or ``freeze``
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.controller = folder / 'controller'
        self.truth = folder / 'truth'
        self.faults = folder / 'faults'
        self.camera_fault = folder / 'camera_fault'
        self._cell = folder / 'cell.yaml'
        self._camera = folder / 'camera.yaml'
        self._part = folder / 'part.npz'
        self._light = folder / 'light.yaml'

    def write(self, description: LiveDescription) -> None:
        """
        Write the description.

        :raises FileError: the folder cannot be written
        """
        save_cell(self._cell, description.cell)
        save_camera(self._camera, description.cell.camera)
        if description.solid is not None:
            with files.atomic_file(self._part) as path, path.open('wb') as stream:
                np.savez(
                    stream,
                    vertices_xyz=description.solid.vertices_xyz,
                    faces=description.solid.faces,
                )
        light = {'seed': description.seed, 'optics': vars(description.optics)}
        files.write_text(self._light, yaml.safe_dump(light))

    def read(self) -> LiveDescription:
        """
        Read the description.

        :raises FileError: there is no simulated cell in the folder
        """
        camera = load_camera(self._camera)
        cell = load_cell(self._cell, camera)
        try:
            light = yaml.safe_load(self._light.read_text(encoding='utf-8'))
            optics, seed = Optics(**light['optics']), int(light['seed'])
            solid = self._read_part() if self._part.exists() else None
        except (OSError, ValueError, KeyError, TypeError, yaml.YAMLError) as error:
            raise FileError(
                f'{self.folder}: does not describe a simulated cell: {error}'
            ) from error
        return LiveDescription(cell=cell, solid=solid, optics=optics, seed=seed)

    def clear(self) -> None:
        """Remove all files of the cell."""
        for path in (
            self.controller,
            self.truth,
            self.faults,
            self.camera_fault,
            self._cell,
            self._camera,
            self._part,
            self._light,
        ):
            path.unlink(missing_ok=True)

    def _read_part(self) -> Solid:
        with np.load(self._part) as arrays:
            return Solid(vertices_xyz=arrays['vertices_xyz'], faces=arrays['faces'])
