# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Approximate nearest neighbor of a point, by look-up in a voxel grid.

One look-up per point makes it possible to score a million candidate poses.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt

from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints

# 4 bytes each for the index, and as much again several times while it is computed.
_MAX_CELLS = 30_000_000


@dataclass(frozen=True, eq=False, kw_only=True)
class NearestGrid:
    """
    A voxel grid that stores the index of the nearest point for every cell.

    index : (nx, ny, nz) of the point, -1 beyond the search radius
    origin : (3,) meters, corner of the first cell
    step : meters, edge of a cell
    """

    index: Ints
    origin: Floats
    step: float

    @classmethod
    def build(cls, points_xyz: Floats, step: float, search_radius: float) -> 'NearestGrid':
        """
        Build the grid of (n, 3) points.

        step : meters, edge of a cell; larger for very large parts, to limit the memory
        search_radius : meters, beyond which there is no nearest point
        """
        low = points_xyz.min(axis=0) - search_radius - step
        size = points_xyz.max(axis=0) + search_radius + step - low
        step = max(step, float(np.cbrt(size.prod() / _MAX_CELLS)))
        shape = np.ceil(size / step).astype(np.int64) + 1
        cell = tuple(np.floor((points_xyz - low) / step).astype(np.int64).T)
        owner = np.full(shape, -1, dtype=np.int32)
        owner[cell] = np.arange(len(points_xyz), dtype=np.int32)
        distance, nearest = distance_transform_edt(owner < 0, return_indices=True)
        index = owner[tuple(nearest)]
        index[distance * step > search_radius] = -1
        return cls(index=index, origin=low, step=step)

    def query(self, points_xyz: Floats) -> Ints:
        """
        Return the index of the approximately nearest point of (..., 3) points; -1 for none.

        Its distance exceeds that of the nearest one by at most two diagonals of a cell.
        """
        cell = np.floor((points_xyz - self.origin) / self.step).astype(np.int32)
        shape = np.array(self.index.shape)
        inside = ((cell >= 0) & (cell < shape)).all(axis=-1)
        cell[~inside] = 0
        found = self.index[cell[..., 0], cell[..., 1], cell[..., 2]]
        return np.asarray(np.where(inside, found, -1))
