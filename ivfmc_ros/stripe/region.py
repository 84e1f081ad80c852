# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where in the picture the stripe of a laser can be when it lies on the part."""

from dataclasses import dataclass

import cv2
import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.laser import Stripe as Direction
from ivfmc_ros.cell.volume import Volume
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Bytes

Window = tuple[slice, slice]


@dataclass(frozen=True, eq=False)
class Region:
    """
    Where in a picture the stripe can be, and the rectangle that holds it.

    mask : (height, width) uint8, 255 where the stripe can be, else 0
    rows, columns : (first, after the last) of them
    """

    mask: Bytes
    rows: tuple[int, int]
    columns: tuple[int, int]

    @classmethod
    def of(cls, mask: Bools) -> 'Region':
        """Return the region of a (height, width) mask."""
        rows, columns = (_extent(np.asarray(mask.any(axis=axis))) for axis in (1, 0))
        return cls(np.uint8(255) * mask, rows, columns)

    def window(self, stripe: Direction, reach: int) -> Window:
        """
        Return the part of the picture to look at, so that what lies outside costs nothing.

        reach : pixels around the region, across the stripe, that are looked at too
        """
        height, width = self.mask.shape
        if stripe == 'rows':
            return slice(*self.rows), _widened(self.columns, reach, width)
        return _widened(self.rows, reach, height), slice(*self.columns)


def _extent(any_inside: Bools) -> tuple[int, int]:
    inside = np.flatnonzero(any_inside)
    # where there can be nothing, nothing is found anywhere
    return (int(inside[0]), int(inside[-1]) + 1) if len(inside) else (0, len(any_inside))


def _widened(extent: tuple[int, int], reach: int, size: int) -> slice:
    return slice(max(extent[0] - reach, 0), min(extent[1] + reach, size))


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
