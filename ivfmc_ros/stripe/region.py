# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where in the picture the stripe of a laser can be when it lies on the part."""

import cv2
import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.volume import Volume
from ivfmc_ros.model import Bools


def stripe_mask(cell: Cell, laser: int, volume: Volume, margin: int = 3) -> Bools:
    """
    Return the pixels whose ray meets the sheet of a laser inside the working volume.

    The wall behind the table, the floor and the table's own skirt carry the stripe too, and
    often brighter than the part; what is masked here cannot be taken for the part.

    margin : pixels by which the region is widened
    returns : (height, width) bool
    """
    camera = cell.camera
    step = 4
    columns = np.arange(0, camera.width + step, step)
    rows = np.arange(0, camera.height + step, step)
    uv = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    points = cell.lasers[laser].intersect(camera.rays(uv))
    base = transforms.apply(transforms.invert(cell.turntable.camera_from_base), points)
    inside = volume.contains(base).reshape(len(rows), len(columns))
    return _enlarge(inside, step, margin)[: camera.height, : camera.width]


def _enlarge(coarse: Bools, step: int, margin: int) -> Bools:
    fine = coarse.astype(np.uint8).repeat(step, axis=0).repeat(step, axis=1)
    # a coarse cell stands for its upper left corner, so the region grows by one step all around
    size = 2 * (step + margin) + 1
    return cv2.dilate(fine, np.ones((size, size), dtype=np.uint8)) > 0
