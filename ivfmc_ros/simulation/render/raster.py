# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The camera's rays, one a pixel, and how they change over a pixel."""

from functools import lru_cache

import numpy as np

from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints


@lru_cache(maxsize=4)
def pixel_rays(camera: Camera) -> Floats:
    """
    Return the undistorted rays through all pixel centres: (height, width, 2) float64.

    ``[..., 0]`` is x and ``[..., 1]`` y at unit depth, ``camera_optical_frame``. Pixel (0, 0) is
    the centre of the first pixel, so that nothing here is shifted by half a pixel.
    """
    columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    rays = camera.rays(np.stack([columns.ravel(), rows.ravel()], axis=1))
    grid = rays[:, :2].reshape(camera.height, camera.width, 2)
    grid.flags.writeable = False
    return grid


def gather(rays: Floats, rows: Ints, columns: Ints) -> Floats:
    """Return rays of some pixels, (n, 3) float64 of unit depth."""
    chosen = np.ones((len(rows), 3))
    chosen[:, :2] = rays[rows, columns]
    return chosen


def slopes(rays: Floats, rows: Ints, columns: Ints) -> tuple[Floats, Floats]:
    """Return d ray / du and d ray / dv at some pixels, each (n, 3) float64 with z = 0."""
    height, width = rays.shape[:2]
    left, right = np.maximum(columns - 1, 0), np.minimum(columns + 1, width - 1)
    above, below = np.maximum(rows - 1, 0), np.minimum(rows + 1, height - 1)
    along_u, along_v = np.zeros((2, len(rows), 3))
    along_u[:, :2] = (rays[rows, right] - rays[rows, left]) / (right - left)[:, None]
    along_v[:, :2] = (rays[below, columns] - rays[above, columns]) / (below - above)[:, None]
    return along_u, along_v
