# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A simulated cell whose lasers warm up: the stripe creeps after a laser was switched on.

``python -m support.warming_camera up ...`` is ``ivfmc up ...`` with this camera; the variable
IVFMC_WARM_UP has the shift of the stripe when the laser is switched on (pixels) and the time
constant of its decay (seconds).
"""

import math
import os
import sys
import time

import cv2
import numpy as np

from ivfmc_ros.simulation.live import camera as live_camera
from support.camera_of_cell import run_with_camera
from support.cell_rig import Cell

WARM_UP = 'IVFMC_WARM_UP'


class WarmingCell(Cell):
    """``ivfmc up`` with this camera."""

    MODULE = 'support.warming_camera'


class _WarmingScene:
    def __init__(self, scene):
        self._scene = scene
        self._shift, self._decay_s = map(float, os.environ[WARM_UP].split())
        self._lit = ()
        self._lit_s = 0.0

    def render(self, angle, powers, ambient_factor=1.0):
        image = self._scene.render(angle, powers, ambient_factor)
        lit, now = tuple(np.flatnonzero(powers)), time.monotonic()
        if lit != self._lit:
            self._lit, self._lit_s = lit, now
        shift = self._shift * math.exp((self._lit_s - now) / self._decay_s)
        move = np.array([[1.0, 0.0, shift], [0.0, 1.0, 0.0]])
        return cv2.warpAffine(image, move, image.shape[::-1], borderMode=cv2.BORDER_REPLICATE)


class WarmingCamera(live_camera.SimulatedCamera):
    """A simulated camera of lasers that warm up."""

    def open(self):
        super().open()
        self._scene = _WarmingScene(self._scene)


if __name__ == '__main__':
    sys.exit(run_with_camera(WarmingCamera, WarmingCell.MODULE))
