# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Region of interest of a laser: the pixels that see its plane inside the working volume."""

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
class RegionOfInterest:
    """
    A mask of pixels and its bounding rectangle.

    mask : (height, width) uint8, 255 where the stripe can be, else 0
    rows, columns : bounding rectangle, (first, one past the last)
    """

    mask: Bytes
    rows: tuple[int, int]
    columns: tuple[int, int]

    @classmethod
    def of(cls, mask: Bools) -> 'RegionOfInterest':
        """Return the region of interest of a (height, width) mask."""
        rows, columns = (_extent(np.asarray(mask.any(axis=axis))) for axis in (1, 0))
        return cls(np.uint8(255) * mask, rows, columns)

    def window(self, stripe: Direction, margin: int) -> Window:
        """
        Return the (row, column) slices to crop an image to.

        margin : pixels added to both sides of the bounding rectangle, across the stripe
        """
        height, width = self.mask.shape
        if stripe == 'rows':
            return slice(*self.rows), _widened(self.columns, margin, width)
        return _widened(self.rows, margin, height), slice(*self.columns)


def _extent(any_inside: Bools) -> tuple[int, int]:
    inside = np.flatnonzero(any_inside)
    # an empty mask gives the whole image; the mask itself then rejects every peak
    return (int(inside[0]), int(inside[-1]) + 1) if len(inside) else (0, len(any_inside))


def _widened(extent: tuple[int, int], margin: int, size: int) -> slice:
    return slice(max(extent[0] - margin, 0), min(extent[1] + margin, size))


def stripe_mask(cell: Cell, laser: int, volume: Volume, margin: int = 3) -> Bools:
    """
    Return the pixels whose ray meets the plane of a laser inside the working volume.

    The stripe on the wall behind the table, on the floor or on the edge of the table is masked
    out; it is often brighter than the one on the part.

    margin : pixels by which the mask is dilated
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
    # a coarse cell is sampled at its upper left corner: dilate by one step to every side
    size = 2 * (step + margin) + 1
    return cv2.dilate(fine, np.ones((size, size), dtype=np.uint8)) > 0
