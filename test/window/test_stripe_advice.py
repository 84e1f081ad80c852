# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.window.stripe_advice import stripe_shares


def shares(peak=120, missing=0, sigma=None, transpose=False):
    rows = np.arange(100, 300)
    kept = np.ones(len(rows), dtype=bool)
    kept[20 : 20 + missing] = False
    rows = rows[kept]
    image = np.full((400, 320), 8, dtype=np.uint8)
    image[:, 158:163] = peak
    uv = np.column_stack([np.full(len(rows), 160.2), rows.astype(float)])
    intensity = np.full(len(rows), float(peak - 8))
    sigma = np.full(len(rows), 2e-5) if sigma is None else sigma[kept]
    if transpose:
        image, uv = np.ascontiguousarray(image.T), uv[:, ::-1]
    return stripe_shares(image, uv, intensity, sigma)


@pytest.mark.parametrize('transpose', [False, True])
def test_good_stripe_needs_no_advice(transpose):
    found = shares(transpose=transpose)
    assert (found.rows, found.saturated, found.weak, found.missing) == (200, 0.0, 0.0, 0.0)
    assert found.advice == ''


def test_saturated_stripe_asks_for_less_exposure():
    assert shares(peak=255).advice == 'lower the exposure: 100% of the stripe is saturated'


def test_weak_stripe_asks_for_more():
    assert 'raise the exposure' in shares(peak=15).advice


def test_rows_without_a_point_are_counted():
    found = shares(missing=100)
    assert found.missing == pytest.approx(0.5, abs=0.01)
    assert 'of the rows have no point' in found.advice


def test_uncertain_points_are_counted():
    sigma = np.full(200, 2e-5)
    sigma[:50] = 2e-4
    assert shares(sigma=sigma).uncertain == pytest.approx(0.25)


def test_no_stripe_asks_for_the_laser():
    empty = np.zeros(0)
    found = stripe_shares(np.zeros((4, 4), np.uint8), np.zeros((0, 2)), empty, empty)
    assert found.rows == 0
    assert 'is the laser on' in found.advice
