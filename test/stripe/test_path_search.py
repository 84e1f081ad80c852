# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import itertools

import numpy as np
import pytest
from support.synthetic import draw_stripe
from support.synthetic import expose

from ivfmc_ros.stripe import path_search
from ivfmc_ros.stripe.extract import extract
from ivfmc_ros.stripe.extract import ExtractSettings

ROWS, COLUMNS = 200, 300


def stripe(u, first, after, **light):
    rows = np.arange(first, after, dtype=np.float64)
    return draw_stripe(np.stack([u[first:after], rows], axis=1), (ROWS, COLUMNS), **light)


def true_columns():
    return 100.0 + 0.1 * np.arange(ROWS)


@pytest.mark.parametrize('ghost', [2.5, 6.0])
def test_brighter_ghost_loses(ghost):
    u = true_columns()
    light = stripe(u, 0, ROWS, peak=80.0)
    light += stripe(u + 60.0, 70, 120, peak=150.0, sigma=ghost, ambient=0.0)
    image = expose(light, np.random.default_rng(1), speckle=0.15)
    found = extract(image)
    assert len(found) > 0.99 * ROWS
    assert np.abs(found.uv[:, 0] - u[found.uv[:, 1].astype(int)]).max() < 1.0
    blind = extract(image, settings=ExtractSettings(path=False))
    assert np.count_nonzero(np.abs(blind.uv[:, 0] - u[blind.uv[:, 1].astype(int)]) > 30) >= 45


def test_stripe_may_jump_at_a_step():
    u = true_columns()
    u[100:] += 50.0
    found = extract(expose(stripe(u, 0, ROWS), np.random.default_rng(2)))
    assert np.array_equal(found.uv[:, 1], np.arange(ROWS))
    assert np.abs(found.uv[:, 0] - u).max() < 0.5


def test_no_peak_is_no_choice():
    image = expose(stripe(true_columns(), 50, 100), np.random.default_rng(3))
    assert set(extract(image).uv[:, 1].astype(int)) == set(range(50, 100))


def test_doubling_finds_the_cheapest_of_all_paths():
    rng = np.random.default_rng(4)
    start = rng.random(3).astype(np.float32)
    steps = rng.random((3, 3, 6)).astype(np.float32)
    least = path_search.path_costs(start, steps)
    for row, peak in itertools.product(range(7), range(3)):
        costs = [
            start[way[0]] + sum(steps[way[k], way[k + 1], k] for k in range(row))
            for way in itertools.product(range(3), repeat=row + 1)
            if way[-1] == peak
        ]
        assert least[peak, row] == pytest.approx(min(costs), rel=1e-5)
