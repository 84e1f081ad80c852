# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scans of a table that loses steps at one moment, from the stripes of a turn without a slip."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.model import View
from ivfmc_ros.stripe.stripe import Stripe
from support.erring_table import noisy
from support.erring_table import Sweep
from support.erring_table import views_of


@dataclass(frozen=True, eq=False, kw_only=True)
class SlippingScan:
    """
    Sweeps of all lasers, one after the other, over a turn.

    stripes : of each laser, at the same angles of a turn, of equal steps
    size : radians by which the table lags the reported angle after the slip
    after : number of profiles before the slip, counted over all sweeps
    lasers : indices of those that are used
    closure : profiles of a sweep beyond the turn
    seed : of the noise that is added to each profile; None for none
    """

    cell: Cell
    stripes: Sequence[Sequence[Stripe]]
    size: float = 0.0
    after: int = 0
    lasers: Sequence[int] = (0, 1)
    closure: int = 0
    seed: int | None = None

    @property
    def steps(self) -> int:
        """Profiles of a turn."""
        return len(self.stripes[0])

    @property
    def step(self) -> float:
        """Radians between two profiles."""
        return float(2.0 * np.pi / self.steps)

    def views(self, *, true: bool = False) -> list[View]:
        """Return the views at the reported angles, or at the true ones."""
        rng = None if self.seed is None else np.random.default_rng(self.seed)
        # whole steps of the slip repeat or skip profiles; the rest changes the reported angles
        whole = round(self.size / self.step)
        lines, sweeps = [], []
        for number, laser in enumerate(self.lasers):
            index = np.arange(self.steps + self.closure)
            late = index + number * len(index) >= self.after
            at = index - late * whole
            seen = [self.stripes[laser][k % self.steps] for k in at]
            lines.append([noisy(one, rng) for one in seen] if rng else seen)
            angles = at * self.step
            sweeps.append(Sweep(laser=laser, commanded=angles + late * self.size, true=angles))
        return views_of(self.cell, lines, sweeps, true=true)
