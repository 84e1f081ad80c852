# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.stripe.exposure_bracket import merge_exposures
from ivfmc_ros.stripe.stripe import Stripe


def stripe(rows, u, sigma, direction='rows'):
    rows, u = np.asarray(rows, dtype=float), np.asarray(u, dtype=float)
    pair = [u, rows] if direction == 'rows' else [rows, u]
    ones = np.ones(len(rows))
    return Stripe(uv=np.stack(pair, axis=1), intensity=50 * ones, width=ones, sigma=sigma * ones)


@pytest.mark.parametrize('direction', ['rows', 'columns'])
def test_row_takes_the_most_certain_exposure(direction):
    dim = stripe([4, 5, 6], [10.2, 11.2, 12.2], 0.3, direction)
    bright = stripe([5, 6, 7], [11.0, 12.0, 13.0], 0.1, direction)
    merged = merge_exposures([dim, bright], direction)
    along, across = (1, 0) if direction == 'rows' else (0, 1)
    assert merged.uv[:, along].tolist() == [4, 5, 6, 7]
    assert merged.uv[:, across].tolist() == [10.2, 11.0, 12.0, 13.0]
    assert merged.sigma.tolist() == [0.3, 0.1, 0.1, 0.1]


def test_contradicted_row_is_empty_unless_most_confirm_it():
    one = stripe([1, 2], [50.0, 50.0], 0.1)
    other = stripe([1, 2], [80.0, 80.0], 0.2)
    third = stripe([2], [50.1], 0.3)
    merged = merge_exposures([one, other, third], 'rows')
    assert merged.uv.tolist() == [[50.0, 2.0]]


def test_positions_within_their_sigma_do_not_contradict():
    merged = merge_exposures([stripe([1], [50.0], 0.2), stripe([1], [51.0], 0.5)], 'rows')
    assert merged.uv.tolist() == [[50.0, 1.0]]


def test_nothing_gives_nothing():
    assert not len(merge_exposures([stripe([], [], 0.1), stripe([], [], 0.1)], 'rows'))
