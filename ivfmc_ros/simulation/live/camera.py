# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Camera of a simulated cell: renders the true table position and laser power of an exposure."""

import math
from pathlib import Path
import time

import numpy as np
from numpy.typing import NDArray

from ivfmc_ros.devices.cameras.device import CameraImage
from ivfmc_ros.devices.cameras.device import Exposure
from ivfmc_ros.devices.cameras.device import REST_PERIOD
from ivfmc_ros.devices.cameras.frame_timer import FrameTimer
from ivfmc_ros.errors import CameraLostError
from ivfmc_ros.errors import FileError
from ivfmc_ros.model import Singles
from ivfmc_ros.simulation.live.folder import LiveFolder
from ivfmc_ros.simulation.live.truth import TruthReader
from ivfmc_ros.simulation.render.optics import add_speckle
from ivfmc_ros.simulation.render.optics import Optics
from ivfmc_ros.simulation.render.optics import WHITE
from ivfmc_ros.simulation.render.renderer import StripeRenderer

NOMINAL_EXPOSURE = 0.005  # seconds, at which the gray values of Optics are valid

_DARK_POOL_SIZE = 1.5  # dark pixels, in images; each image takes a random section of the pool
_TRUTH_DELAY = 0.002  # seconds by which the process of the cell may write late
_TRIGGER_POLL = 0.005  # seconds between looks for pulses of the trigger line
# Seconds: pulses that are older than this, while images are rendered, find no free buffer.
_MAX_TRIGGER_AGE = 0.4


class SimulatedCamera:
    """
    A CameraDevice in a simulated cell.

    While it is triggered, each pulse of the cell's trigger line starts an exposure; a pulse in an
    exposure is ignored, as by a real camera.

    folder : of the simulated cell, see LiveFolder
    """

    def __init__(self, folder: Path, exposure: Exposure) -> None:
        self._folder, self._exposure = folder, exposure
        self._timer = FrameTimer()
        self._is_resting = False
        self.warning = ''
        self._truth: TruthReader | None = None
        self._scene: LiveScene | None = None
        self._last_image: NDArray[np.uint8] | None = None
        self._exposed_until = -math.inf

    def open(self) -> None:
        """
        Read the description of the cell.

        :raises CameraLostError: there is no simulated cell in the folder, or it is unplugged
        """
        self._require_plugged()
        try:
            self._truth = TruthReader(LiveFolder(self._folder).truth)
            self._scene = LiveScene(LiveFolder(self._folder))
        except FileError as error:
            raise CameraLostError(f'simulated camera: {error}') from error

    def grab(self, timeout: float) -> CameraImage | None:
        """
        Return the next image, None if there is none within ``timeout`` seconds.

        Rendering reaches about 15 images per second.

        :raises CameraLostError: the camera is not open, or the cell has ended
        """
        exposure = self._exposure
        if self._truth is None or self._scene is None:
            raise CameraLostError('simulated camera: is not open')
        start = self._next_start(self._truth, exposure, timeout)
        if start is None:
            return None
        stamp_ns = time.time_ns() - round((time.monotonic() - start) * 1e9)
        self._exposed_until = start + exposure.seconds
        # motion and lasers during the exposure are known after it
        time.sleep(max(0.0, self._exposed_until + _TRUTH_DELAY - time.monotonic()))
        if not LiveFolder(self._folder).truth.exists():
            raise CameraLostError(
                f'simulated camera: {self._folder}: the simulated cell has ended'
            )
        frozen = self._require_plugged() == 'freeze'
        if frozen and self._last_image is not None:
            return CameraImage(image=self._last_image, stamp_ns=stamp_ns)
        angle, _ = self._truth.table_state(start + exposure.seconds / 2)
        powers = self._truth.mean_laser_powers(start, start + exposure.seconds)
        brightness = exposure.gain * exposure.seconds / NOMINAL_EXPOSURE
        image = self._scene.render(angle, brightness * powers, brightness)
        self._last_image = image
        return CameraImage(image=image, stamp_ns=stamp_ns)

    def _require_plugged(self) -> str:
        """
        Return the fault of the camera, '' for none.

        :raises CameraLostError: it is unplugged
        """
        path = LiveFolder(self._folder).camera_fault
        fault = path.read_text(encoding='utf-8').strip() if path.exists() else ''
        if fault == 'unplug':
            raise CameraLostError('simulated camera: is unplugged')
        return fault

    def _next_start(self, truth: TruthReader, exposure: Exposure, timeout: float) -> float | None:
        """Return when the next exposure begins or began, steady seconds; None after a timeout."""
        if not exposure.triggered:
            period = 1 / exposure.frame_rate
            period = max(period, REST_PERIOD) if self._is_resting else period
            due = self._timer.wait_next(period, timeout)
            return None if due is None else time.monotonic()
        end = time.monotonic() + timeout
        while exposure is self._exposure:
            now = time.monotonic()
            pulses = truth.triggers_after(max(self._exposed_until, now - _MAX_TRIGGER_AGE))
            if pulses or now >= end:
                return pulses[0] if pulses else None
            time.sleep(_TRIGGER_POLL)
        return None

    def set_exposure(self, exposure: Exposure) -> None:
        """Apply exposure, gain and frame rate to the following images."""
        self._exposure = exposure

    def rest(self, resting: bool) -> None:
        """Render an image each ``REST_PERIOD`` only while ``resting``."""
        self._is_resting = resting
        # the next image is due at once
        self._timer = FrameTimer()

    def close(self) -> None:
        """Release the cell."""
        self._truth = self._scene = None


class LiveScene:
    """
    Renders images of a simulated cell in real time.

    Noise of the many dark pixels is drawn once and reused; only lit pixels are computed for each
    image.
    """

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
        # the first image takes longer, because the renderer builds its tables
        self._renderer.light(0.0, 0)

    def render(
        self, angle: float, powers: NDArray[np.float64], ambient_factor: float = 1.0
    ) -> NDArray[np.uint8]:
        """
        Return the image of the sensor, (height, width).

        angle : of the table, radians
        powers : (lasers,) of each laser, relative to the peak of Optics
        ambient_factor : ambient light relative to that of Optics
        """
        ambient = self._optics.ambient * ambient_factor
        image = self._dark_image(ambient)
        light = self._laser_light(angle, powers)
        if light is not None:
            lit = np.flatnonzero(light)
            signal = add_speckle(light.ravel()[lit], self._optics.speckle, self._rng)
            image.ravel()[lit] = self._expose(signal + ambient)
        return image

    def _laser_light(self, angle: float, powers: NDArray[np.float64]) -> Singles | None:
        total: Singles | None = None
        for laser, power in enumerate(powers[: self._lasers].tolist()):
            if power > 0:
                light = self._renderer.light(angle, laser) * np.float32(power)
                total = light if total is None else total + light
        return total

    def _dark_image(self, level: float) -> NDArray[np.uint8]:
        """Return a random section of the pool; drawing fresh noise takes longest of all steps."""
        height, width = self._camera.height, self._camera.width
        pixels = height * width
        if self._dark is None or level != self._dark_level:
            pool = np.full(round(_DARK_POOL_SIZE * pixels), level, dtype=np.float32)
            self._dark, self._dark_level = self._expose(pool), level
        start = int(self._rng.integers(len(self._dark) - pixels))
        return self._dark[start : start + pixels].reshape(height, width).copy()

    def _expose(self, signal: Singles) -> NDArray[np.uint8]:
        """Return gray values of light with read and shot noise, as ``optics.expose`` does."""
        optics: Optics = self._optics
        variance = optics.read_noise**2 + np.maximum(signal, 0) / optics.electrons_per_dn
        noise = self._rng.standard_normal(signal.shape, dtype=np.float32)
        gray = np.rint(signal + np.sqrt(variance, dtype=np.float32) * noise)
        return np.asarray(np.clip(gray, 0, WHITE).astype(np.uint8))
