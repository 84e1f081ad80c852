# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scans of one laser whose light sheet moves evenly while the sweep is taken."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.model import View
from ivfmc_ros.stripe.stripe import Stripe
from support.slipping_scan import SlippingScan


def drifting_view(
    cell: Cell,
    stripes: Sequence[Sequence[Stripe]],
    drift: float,
    *,
    laser: int = 0,
    closure: int = 5,
    degrees: float = 0.0,
    seed: int | None = 5,
) -> View:
    """
    Return a view whose sheet has moved by ``drift`` meters along its normal after a turn.

    The stripes stay and the sheet by which the points are computed moves the other way, which is
    the same to first order.

    degrees : by which the table lags after a third of the turn
    """
    size, after = np.radians(degrees), len(stripes[0]) // 3

    def seen(offset: float) -> View:
        lasers = list(cell.lasers)
        lasers[laser] = replace(lasers[laser], offset=lasers[laser].offset + offset)
        scan = SlippingScan(
            cell=replace(cell, lasers=tuple(lasers)), stripes=stripes, size=size, after=after,
            lasers=(laser,), closure=closure, seed=seed,
        )  # fmt: skip
        return scan.views()[0]

    still, moved = seen(0.0), seen(drift)
    share = np.arange(len(still.angles)) / len(stripes[0])
    points = still.points_xyz + share[:, None] * (moved.points_xyz - still.points_xyz)
    return replace(still, points_xyz=points)
