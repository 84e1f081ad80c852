# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from support.synthetic import draw_stripe
from support.synthetic import expose

from ivfmc_ros.stripe.peaks import find_peaks
from ivfmc_ros.stripe.peaks import PeakSearch

SEARCH = PeakSearch(box=5, threshold=5.0, further_threshold=8.0, max_sigma=12.0)


def stripes(*places, **light):
    rows = np.arange(100.0)
    total = np.full((100, 400), 6.0)
    for place, peak, sigma in places:
        uv = np.stack([np.full(100, place), rows], axis=1)
        total += draw_stripe(uv, total.shape, peak=peak, sigma=sigma, ambient=0.0)
    return expose(total, np.random.default_rng(1), **light)


def test_peaks_are_sorted_measured_and_no_more_than_there_are():
    image = stripes((100.0, 60.0, 2.0), (250.0, 150.0, 4.0))
    found = find_peaks(image, 1.0, SEARCH, None)
    assert found.column[:, 0] == pytest.approx(np.full(100, 250), abs=4)
    assert found.column[:, 1] == pytest.approx(np.full(100, 100), abs=3)
    assert np.median(found.width[:, :2], axis=0) == pytest.approx([4.0, 2.0], rel=0.15)
    assert not np.isfinite(found.width[:, 2]).any()


def test_dim_stripe_beside_a_glowing_field_is_found():
    image = stripes((300.0, 50.0, 2.5), speckle=0.0)
    field = np.random.default_rng(3).gamma(400.0, 240.0 / 400.0, (100, 120))
    image[:, 60:180] = np.clip(field, 0, 255).astype(np.uint8)
    found = find_peaks(image, 1.0, SEARCH, None)
    near = np.abs(found.column + np.nan_to_num(found.middle, nan=999.0) - 300.0) < 3.0
    assert near.any(axis=1).mean() > 0.95


def test_mask_hides_a_peak_but_not_its_surroundings():
    image = stripes((100.0, 60.0, 2.0), (250.0, 150.0, 4.0))
    mask = np.zeros(image.shape, dtype=np.uint8)
    mask[:, 98:103] = 255
    found = find_peaks(image, 1.0, SEARCH, mask)
    assert found.column[:, 0] == pytest.approx(np.full(100, 100), abs=2)
    assert np.nanmedian(found.width[:, 0]) == pytest.approx(2.0, rel=0.15)
