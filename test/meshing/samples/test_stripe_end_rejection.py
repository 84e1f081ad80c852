# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np

from ivfmc_ros.meshing.samples.stripe_end_rejection import run_ends
from ivfmc_ros.meshing.samples.stripe_end_rejection import truncated_ends

SIGMA = 2e-5
STEP = 2e-4


def stripes(lengths):
    """Return straight noisy runs, one per column, and which points continue in the next row."""
    rng = np.random.default_rng(0)
    rows = np.arange(max(lengths) + 4)
    points = np.full((len(rows), len(lengths), 3), np.nan)
    for column, length in enumerate(lengths):
        run = rows[2 : 2 + length]
        points[run, column, 0] = column * 5e-4
        points[run, column, 1] = rng.normal(scale=0.3 * SIGMA, size=length)
        points[run, column, 2] = run * STEP
    known = np.isfinite(points[..., 0])
    down = known & np.roll(known, -1, axis=0)
    return points, down


def test_straight_stripes_keep_their_ends():
    points, down = stripes([40, 60])
    assert not truncated_ends(points, down, SIGMA).any()


def test_only_ends_off_the_line_are_truncated():
    points, down = stripes([40, 60])
    points[2, 0, 1] += 12 * SIGMA
    points[61, 1, 1] -= 12 * SIGMA
    truncated = truncated_ends(points, down, SIGMA)
    assert sorted(zip(*np.nonzero(truncated), strict=True)) == [(2, 0), (61, 1)]


def test_point_in_the_middle_is_no_end():
    points, down = stripes([40])
    points[20, 0, 1] += 12 * SIGMA
    assert not truncated_ends(points, down, SIGMA).any()


def test_short_run_loses_both_ends_once():
    points, down = stripes([4, 1, 40])
    truncated = truncated_ends(points, down, SIGMA)
    assert sorted(zip(*np.nonzero(truncated), strict=True)) == [(2, 0), (2, 1), (5, 0)]


def test_curved_stripe_keeps_its_ends():
    points, down = stripes([60])
    height = points[:, 0, 2]
    points[:, 0, 1] += (height - 6e-3) ** 2 / (2 * 0.012)
    assert not truncated_ends(points, down, SIGMA).any()


def test_run_ends_are_the_first_and_the_last_of_each_run():
    points, down = stripes([4, 1])
    ends = run_ends(np.isfinite(points[..., 0]), down)
    assert sorted(zip(*np.nonzero(ends), strict=True)) == [(2, 0), (2, 1), (5, 0)]
