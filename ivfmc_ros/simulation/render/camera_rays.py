# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rays of all pixels of a camera, and their derivatives by the pixel coordinates."""

from functools import lru_cache

import numpy as np

from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints


@lru_cache(maxsize=4)
def pixel_rays(camera: Camera) -> Floats:
    """
    Return the undistorted rays through all pixel centers: (height, width, 2) float64.

    ``[..., 0]`` is x and ``[..., 1]`` y at unit depth, ``camera_optical_frame``. Pixel (0, 0) is
    the center of the first pixel (OpenCV's convention).
    """
    columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    rays = camera.rays(np.stack([columns.ravel(), rows.ravel()], axis=1))
    grid = rays[:, :2].reshape(camera.height, camera.width, 2)
    grid.flags.writeable = False
    return grid


def rays_at(rays: Floats, rows: Ints, columns: Ints) -> Floats:
    """Return the rays of selected pixels, (n, 3) float64 of unit depth."""
    chosen = np.ones((len(rows), 3))
    chosen[:, :2] = rays[rows, columns]
    return chosen


def ray_derivatives(rays: Floats, rows: Ints, columns: Ints) -> tuple[Floats, Floats]:
    """Return d ray / du and d ray / dv of selected pixels, each (n, 3) float64 with z = 0."""
    height, width = rays.shape[:2]
    left, right = np.maximum(columns - 1, 0), np.minimum(columns + 1, width - 1)
    above, below = np.maximum(rows - 1, 0), np.minimum(rows + 1, height - 1)
    along_u, along_v = np.zeros((2, len(rows), 3))
    along_u[:, :2] = (rays[rows, right] - rays[rows, left]) / (right - left)[:, None]
    along_v[:, :2] = (rays[below, columns] - rays[above, columns]) / (below - above)[:, None]
    return along_u, along_v
