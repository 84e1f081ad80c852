# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Runs of connected points in the rows of a range grid, whose last column may meet the first."""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.model import Bools
from ivfmc_ros.model import Ints


@dataclass(frozen=True, eq=False, kw_only=True)
class ConnectedRuns:
    """
    First and last point of the run that each point belongs to.

    first, last : (rows, columns) columns, unwrapped: below 0 or above the last column where the
        run goes on across the seam of a full turn
    """

    first: Ints
    last: Ints

    @classmethod
    def of(cls, right: Bools, max_steps: int) -> 'ConnectedRuns':
        """
        Find the runs, cut at ``max_steps`` columns to either side of each point.

        right : (rows, columns) bool, the next point is connected; the last column to the first
        """
        count = right.shape[1]
        place = np.arange(3 * count)
        thrice = np.concatenate([right] * 3, axis=1)
        # the nearest column at or after, and at or before, without a connection to its next
        ends = np.where(thrice, 3 * count, place)
        last = np.minimum.accumulate(ends[:, ::-1], axis=1)[:, ::-1]
        starts = np.where(np.roll(thrice, 1, axis=1), -1, place)
        first = np.maximum.accumulate(starts, axis=1)
        middle = slice(count, 2 * count)
        own = place[middle]
        return cls(
            first=np.maximum(first[:, middle], own - max_steps) - count,
            last=np.minimum(last[:, middle], own + max_steps) - count,
        )

    @property
    def reach(self) -> Ints:
        """(rows, columns) columns to the nearer end of the run."""
        own = np.arange(self.first.shape[1])
        return np.asarray(np.minimum(self.last - own, own - self.first))
