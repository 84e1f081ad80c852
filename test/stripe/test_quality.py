# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from support.synthetic import draw_stripe
from support.synthetic import expose

from ivfmc_ros.stripe.extract import extract
from ivfmc_ros.stripe.extract import ExtractSettings
from ivfmc_ros.stripe.noise import SensorNoise

ROWS, COLUMNS = 300, 200
MIDDLE = 100.3
SIGMA = 2.5


def picture(cut, rest, speckle=0.0, seed=1):
    """A stripe of which ``rest`` is left beyond ``cut`` sigmas, in the middle hundred rows."""
    uv = np.stack([np.full(ROWS, MIDDLE), np.arange(ROWS, dtype=np.float64)], axis=1)
    light = draw_stripe(uv, (ROWS, COLUMNS), sigma=SIGMA) - 6.0
    beyond = np.clip(np.arange(COLUMNS) + 0.5 - MIDDLE - cut * SIGMA, 0.0, 1.0)
    light[100:200] *= 1.0 - (1.0 - rest) * beyond
    return expose(light + 6.0, np.random.default_rng(seed), speckle=speckle)


def measure(image, speckle=0.0, **settings):
    settings = ExtractSettings(
        noise=SensorNoise(speckle=speckle), max_error=50.0, max_uncertainty=50.0, **settings
    )
    found = extract(image, settings=settings)
    cut = (found.uv[:, 1] >= 105) & (found.uv[:, 1] < 195)
    return np.abs(found.uv[:, 0] - MIDDLE), found.sigma, cut


@pytest.mark.parametrize('rest', [0.0, 0.1, 0.5])
@pytest.mark.parametrize('cut', [-0.5, 0.0, 0.5, 1.0])
def test_cut_and_two_colored_stripes_claim_a_larger_error(cut, rest):
    error, sigma, inside = measure(picture(cut, rest))
    assert np.median(error[inside]) > 0.15
    # the size of the error, to a factor that grows as less is left of the stripe
    assert np.sqrt(np.mean((error[inside] / sigma[inside]) ** 2)) < 5.0
    assert np.median(sigma[inside]) > 5.0 * np.median(sigma[~inside])
    # others are left as they are
    assert np.median(sigma[~inside]) < 0.05


@pytest.mark.parametrize('cut', [-0.5, 0.0, 0.5])
def test_speckle_does_not_hide_a_long_cut(cut):
    error, sigma, inside = measure(picture(cut, 0.0, speckle=0.15), speckle=0.15)
    assert np.sqrt(np.mean((error[inside] / sigma[inside]) ** 2)) < 2.0
    assert np.median(sigma[~inside]) < 0.12


def test_stripe_that_is_cut_in_all_rows_is_known_by_the_least_width():
    image = np.tile(picture(-0.5, 0.0)[100:200], (3, 1))
    error, sigma, _ = measure(image, least_width=2.0)
    assert (sigma > 0.4 * error).all()


def test_cut_rows_are_dropped_where_edges_must_be_clean():
    settings = ExtractSettings(noise=SensorNoise(speckle=0.0), max_uncertainty=0.5)
    found = extract(picture(-0.5, 0.0), settings=settings)
    rows = set(found.uv[:, 1].astype(int))
    assert not rows & set(range(105, 195))
    assert set(range(90)) | set(range(210, ROWS)) <= rows


def test_switched_off_it_claims_noise_alone():
    _, sigma, inside = measure(picture(0.0, 0.0), shape_uncertainty=False)
    assert sigma[inside].max() < 0.1
