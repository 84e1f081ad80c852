# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The nearest of many points, looked up in a grid: fast enough to try a million poses."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt

from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints

_MOST_CELLS = 30_000_000


@dataclass(frozen=True, eq=False, kw_only=True)
class NearGrid:
    """
    For every cell of a grid the point that is about nearest.

    index : (nx, ny, nz) of the point, -1 beyond the reach; origin : (3,), step : metres
    """

    index: Ints
    origin: Floats
    step: float

    @classmethod
    def of(cls, points_xyz: Floats, step: float, reach: float) -> 'NearGrid':
        """
        Make the grid of (n, 3) points.

        step : metres, edge of a cell (larger for very large parts); reach : metres
        """
        low = points_xyz.min(axis=0) - reach - step
        size = points_xyz.max(axis=0) + reach + step - low
        step = max(step, float(np.cbrt(size.prod() / _MOST_CELLS)))
        shape = np.ceil(size / step).astype(np.int64) + 1
        cell = tuple(np.floor((points_xyz - low) / step).astype(np.int64).T)
        owner = np.full(shape, -1, dtype=np.int32)
        owner[cell] = np.arange(len(points_xyz), dtype=np.int32)
        distance, nearest = distance_transform_edt(owner < 0, return_indices=True)
        index = owner[tuple(nearest)]
        index[distance * step > reach] = -1
        return cls(index=index, origin=low, step=step)

    def find(self, points_xyz: Floats) -> Ints:
        """Return (...) the index of the point about nearest to (..., 3) points; -1 for none."""
        cell = np.floor((points_xyz - self.origin) / self.step).astype(np.int32)
        shape = np.array(self.index.shape)
        inside = ((cell >= 0) & (cell < shape)).all(axis=-1)
        cell[~inside] = 0
        found = self.index[cell[..., 0], cell[..., 1], cell[..., 2]]
        return np.asarray(np.where(inside, found, -1))
