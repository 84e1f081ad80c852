# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A turn of one laser in eight rendered sweeps that overlap and slip; a part that is moved."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.model import Floats
from ivfmc_ros.model import View
from ivfmc_ros.simulation.parts.loading import Solid
from ivfmc_ros.stripe.stripe import Stripe
from support.erring_table import Sweep
from support.erring_table import views_of
from support.rendered_stripes import Job
from support.rendered_stripes import jobs_of
from support.rendered_stripes import stripes_of

SLIP, MOVE = np.radians(0.2), 1e-4
SWEEPS, OVERLAP = 8, 30  # degrees
_WAYS = 3  # directions in which the part is moved; each seed draws one


@dataclass(frozen=True, eq=False)
class SlippingSweeps:
    """
    Sweeps of 75 degrees, each with its own pictures of what it shares with the next.

    steps : pictures a turn
    """

    cell: Cell
    part: Solid
    steps: int

    @property
    def angles(self) -> Floats:
        return np.asarray(2.0 * np.pi * np.arange(self.steps) / self.steps)

    @property
    def moves(self) -> list[Floats]:
        """(4, 4), by which the part may be moved; the first is not at all."""
        ways = 2.0 * np.pi * np.arange(_WAYS) / _WAYS
        shifts = [(0.0, 0.0, 0.0), *((MOVE * np.cos(w), MOVE * np.sin(w), 0.0) for w in ways)]
        return [transforms.rigid(np.eye(3), shift) for shift in shifts]

    @property
    def jobs(self) -> list[Job]:
        """A turn for even sweeps and one for odd ones, of the part moved in each way."""
        turns = [
            Sweep(laser=0, commanded=self.angles, true=self.angles, slip=move)
            for move in self.moves
            for _ in range(2)
        ]
        return jobs_of(self.cell, self.part, turns, 7)

    @cached_property
    def measured(self) -> list[list[Stripe]]:
        return [stripes_of(job) for job in self.jobs]

    def seed(self, seed: int) -> tuple[list[View], list[View]]:
        """Return the views as the table reports them, and as they truly are."""
        rng = np.random.default_rng((10, seed))
        chosen, after = int(rng.integers(_WAYS)) + 1, int(rng.integers(1, SWEEPS))
        sweeps, lines = [], []
        for number in range(SWEEPS):
            move = chosen if number >= after else 0
            first = self.steps * number // SWEEPS
            count = self.steps * (360 // SWEEPS + OVERLAP) // 360
            turns_done, index = np.divmod(np.arange(first, first + count), self.steps)
            true = self.angles[index] + 2.0 * np.pi * turns_done
            seen = self.measured[2 * move + number % 2]
            lines.append([seen[k] for k in index])
            slip = SLIP * rng.standard_normal() * (number > 0)
            sweeps.append(Sweep(laser=0, commanded=true - slip, true=true, slip=self.moves[move]))
        return (
            views_of(self.cell, lines, sweeps),
            views_of(self.cell, lines, sweeps, true=True),
        )
