# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A simulated cell whose camera has its pictures before a scan: as many a second as a real one.

The simulated camera renders 10 to 15 pictures a second on a core. This one holds a picture of each
laser at each of N table angles, and exposes where the moving table passes one of them, so that
picture and angle belong together.

``python -m support.prerendered_camera up ...`` is ``ivfmc up ...`` with this camera; the variable
IVFMC_PICTURES names the folder of the pictures.
"""

import math
import os
from pathlib import Path
import sys
import time

import numpy as np

from ivfmc_ros.cell import cell as cell_model
from ivfmc_ros.devices.cameras.device import Exposure
from ivfmc_ros.simulation.live import camera as live_camera
from ivfmc_ros.simulation.live.truth import TruthReader
from ivfmc_ros.simulation.parts.solids import demo_part
from ivfmc_ros.simulation.render.optics import Optics
from ivfmc_ros.simulation.render.optics import with_sheet_thickness
from ivfmc_ros.simulation.render.renderer import simulate_scan
from support.camera_of_cell import run_with_camera
from support.cell_rig import Cell

PICTURES = 'IVFMC_PICTURES'

_POLL_S = 0.002
# Of an angle at which a picture was taken, in steps of the table.
_SAME = 0.01


class PrerenderedCell(Cell):
    """``ivfmc up`` with this camera."""

    MODULE = 'support.prerendered_camera'


def write_pictures(folder: Path, cell: cell_model.Cell, steps: int, laser: int) -> None:
    """Render the demo part under one laser, (steps, height, width) uint8, at steps of a turn."""
    cell = with_sheet_thickness(cell, Optics())
    height, width = cell.camera.height, cell.camera.width
    pictures = np.lib.format.open_memmap(
        folder / f'{laser}.npy', mode='w+', dtype=np.uint8, shape=(steps, height, width)
    )
    frames = simulate_scan(cell, demo_part(), steps, lasers=[laser], seed=laser)
    for number, frame in enumerate(frames):
        pictures[number] = frame.image
    pictures.flush()


class PrerenderedScene:
    """Looks up the picture nearest to an angle; without a laser or with both it is rendered."""

    def __init__(self, scene: live_camera.LiveScene, folder: Path) -> None:
        self._scene = scene
        # into memory: files that were just written are still being written to the disk, and a
        # picture that is read late is one that a camera would have had
        self._lasers = [np.load(file) for file in sorted(folder.glob('*.npy'))]
        self.step = 2.0 * math.pi / len(self._lasers[0])
        self._last = 0
        self._rng = np.random.default_rng(0)

    def render(self, angle: float, powers: np.ndarray, ambient_factor: float = 1.0) -> np.ndarray:
        number = round(angle / self.step)
        lit = np.flatnonzero(powers)
        if len(lit) != 1:
            return self._scene.render(angle, powers, ambient_factor)
        pictures = self._lasers[lit[0]]
        picture = np.array(pictures[number % len(pictures)])
        if number == self._last or abs(angle / self.step - number) > _SAME:
            # at rest: equal pictures would be those of a frozen camera
            picture ^= self._rng.integers(0, 2, picture.shape, dtype=np.uint8)
        self._last = number
        return picture


class PrerenderedCamera(live_camera.SimulatedCamera):
    """A simulated camera with ``PrerenderedScene``."""

    def __init__(self, folder: Path, exposure: Exposure) -> None:
        super().__init__(folder, exposure)
        self._last_start = -math.inf

    def open(self) -> None:
        super().open()
        self._scene = PrerenderedScene(self._scene, Path(os.environ[PICTURES]))

    def _next_start(self, truth, exposure, timeout):
        end = time.monotonic() + timeout
        period, half = 1.0 / exposure.frame_rate, 0.5 * exposure.seconds
        while time.monotonic() < end:
            now = time.monotonic()
            angle, speed = truth.table_state(now)
            if speed == 0.0:
                return super()._next_start(truth, exposure, end - now)
            step = self._scene.step
            passed = math.floor(angle / step) if speed > 0.0 else math.ceil(angle / step)
            start = _time_of(truth, passed * step, now) - half
            # the picture before is being exposed, or was of the same angle
            if start - self._last_start > 0.8 * period:
                self._last_start = start
                return start
            time.sleep(_POLL_S)
        return None


def _time_of(truth: TruthReader, angle: float, time_s: float) -> float:
    """Return when the table passed an angle shortly before a time; by Newton's method."""
    for _ in range(3):
        found, speed = truth.table_state(time_s)
        if speed == 0.0:
            return -math.inf
        time_s -= (found - angle) / speed
    return time_s


if __name__ == '__main__':
    sys.exit(run_with_camera(PrerenderedCamera, PrerenderedCell.MODULE))
