# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The camera of a simulated cell: renders what table and lasers really did at the exposure."""

from pathlib import Path
import time

import numpy as np
from numpy.typing import NDArray

from ivfmc_ros.devices.cameras.device import Exposure
from ivfmc_ros.devices.cameras.device import Picture
from ivfmc_ros.devices.motion.pacer import Pacer
from ivfmc_ros.errors import CameraLostError
from ivfmc_ros.errors import FileError
from ivfmc_ros.model import Singles
from ivfmc_ros.simulation.live.folder import LiveFolder
from ivfmc_ros.simulation.live.truth import TruthReader
from ivfmc_ros.simulation.render.optics import Optics
from ivfmc_ros.simulation.render.optics import speckled
from ivfmc_ros.simulation.render.optics import WHITE
from ivfmc_ros.simulation.render.renderer import StripeRenderer

USUAL_SECONDS = 0.005  # exposure at which the optics' grey values hold

_DARK_ROOM = 1.5  # dark pixels in store, in pictures; each picture begins somewhere in it
_SETTLED = 0.002  # seconds after the exposure, in which the board's process may be late


class SimulatedCamera:
    """
    A CameraDevice in a simulated cell.

    folder : where the live cell keeps its truth
    """

    def __init__(self, folder: Path, exposure: Exposure) -> None:
        self._folder, self._exposure = folder, exposure
        self._pacer = Pacer()
        self._truth: TruthReader | None = None
        self._scene: LiveScene | None = None

    def open(self) -> None:
        """:raises CameraLostError: there is no simulated cell in the folder."""
        try:
            self._truth = TruthReader(LiveFolder(self._folder).truth)
            self._scene = LiveScene(LiveFolder(self._folder))
        except FileError as error:
            raise CameraLostError(f'simulated camera: {error}') from error

    def grab(self, seconds: float) -> Picture | None:
        """Return the next picture; rendering takes about as long as a picture at 15 a second."""
        exposure = self._exposure
        if self._truth is None or self._scene is None:
            raise CameraLostError('simulated camera: is not open')
        if self._pacer.next(1 / exposure.frame_rate, seconds) is None:
            return None
        start, stamp_ns = time.monotonic(), time.time_ns()
        # what happens during the exposure is known after it
        time.sleep(exposure.seconds + _SETTLED)
        if not LiveFolder(self._folder).truth.exists():
            raise CameraLostError(f'simulated camera: {self._folder}: the cell is gone')
        angle, _ = self._truth.table(start + exposure.seconds / 2)
        powers = self._truth.lasers(start, start + exposure.seconds)
        strength = exposure.gain * exposure.seconds / USUAL_SECONDS
        image = self._scene.picture(angle, strength * powers, strength)
        return Picture(image=image, stamp_ns=stamp_ns)

    def set_exposure(self, exposure: Exposure) -> None:
        """Take the following pictures so."""
        self._exposure = exposure

    def close(self) -> None:
        """Let the cell go."""
        self._truth = self._scene = None


class LiveScene:
    """Renders pictures of a live cell, fast because most of a picture is dark."""

    def __init__(self, folder: LiveFolder) -> None:
        description = folder.read()
        self._optics = description.optics
        self._camera = description.cell.camera
        self._lasers = len(description.cell.lasers)
        self._renderer = StripeRenderer(
            cell=description.cell, solid=description.solid, optics=self._optics
        )
        self._rng = np.random.default_rng(description.seed)
        self._dark: NDArray[np.uint8] | None = None
        self._dark_level = -1.0
        # the renderer prepares what it needs with the first picture
        self._renderer.light(0.0, 0)

    def picture(
        self, angle: float, powers: NDArray[np.float64], strength: float = 1.0
    ) -> NDArray[np.uint8]:
        """
        Return what the sensor sees.

        angle : radians
        powers : (lasers,) of each laser, 1 is the optics' peak
        strength : of the ambient light, 1 is the optics' ambient
        """
        image = self._dark_picture(self._optics.ambient * strength)
        light = self._light(angle, powers)
        if light is not None:
            lit = np.flatnonzero(light)
            signal = speckled(light.ravel()[lit], self._optics.speckle, self._rng)
            image.ravel()[lit] = self._sense(signal + self._optics.ambient * strength)
        return image

    def _light(self, angle: float, powers: NDArray[np.float64]) -> Singles | None:
        total: Singles | None = None
        for laser, power in enumerate(powers[: self._lasers].tolist()):
            if power > 0:
                light = self._renderer.light(angle, laser) * np.float32(power)
                total = light if total is None else total + light
        return total

    def _dark_picture(self, level: float) -> NDArray[np.uint8]:
        """Return a copy of some of the store: noise costs more than all the rest."""
        height, width = self._camera.height, self._camera.width
        pixels = height * width
        if self._dark is None or level != self._dark_level:
            room = np.full(round(_DARK_ROOM * pixels), level, dtype=np.float32)
            self._dark, self._dark_level = self._sense(room), level
        start = int(self._rng.integers(len(self._dark) - pixels))
        return self._dark[start : start + pixels].reshape(height, width).copy()

    def _sense(self, signal: Singles) -> NDArray[np.uint8]:
        """Return the grey values of light, as ``optics.expose`` has them."""
        optics: Optics = self._optics
        variance = optics.read_noise**2 + np.maximum(signal, 0) / optics.electrons_per_dn
        noise = self._rng.standard_normal(signal.shape, dtype=np.float32)
        grey = np.rint(signal + np.sqrt(variance, dtype=np.float32) * noise)
        return np.asarray(np.clip(grey, 0, WHITE).astype(np.uint8))
