# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from support.synthetic import draw_stripe
from support.synthetic import expose

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.stripe.estimators import DEFAULT
from ivfmc_ros.stripe.estimators import METHODS
from ivfmc_ros.stripe.extract import extract
from ivfmc_ros.stripe.extract import ExtractSettings
from ivfmc_ros.stripe.noise import SensorNoise

ROWS, COLUMNS = 1000, 160


def columns():
    return COLUMNS / 2 + np.linspace(-1.0, 1.0, ROWS)


def picture(sigma, rng, speckle=0.0, peak=150.0):
    uv = np.stack([columns(), np.arange(ROWS, dtype=np.float64)], axis=1)
    return expose(draw_stripe(uv, (ROWS, COLUMNS), sigma=sigma, peak=peak), rng, speckle=speckle)


def errors(image, **settings):
    found = extract(
        image, settings=ExtractSettings(max_error=50.0, max_uncertainty=50.0, **settings)
    )
    return found.uv[:, 0] - columns()[found.uv[:, 1].astype(int)], found.sigma


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize('sigma', [1.5, 2.5, 5.0])
def test_every_method_is_unbiased_and_knows_its_error(method, sigma):
    image = picture(sigma, np.random.default_rng(1))
    error, claimed = errors(image, method=method, noise=SensorNoise(speckle=0.0))
    assert len(error) == ROWS
    assert abs(error.mean()) < 5.0 * error.std() / np.sqrt(ROWS) + 0.005
    assert 0.6 < np.sqrt(np.mean((error / claimed) ** 2)) < 1.25


def test_default_is_the_best_under_speckle():
    image = picture(2.5, np.random.default_rng(2), speckle=0.15)
    spread = {method: errors(image, method=method)[0].std() for method in METHODS}
    assert min(spread, key=spread.get) == DEFAULT
    assert spread['gaussian'] < 0.095
    assert spread['gaussian'] < 0.9 * spread['centre_of_mass']
    # without weights the speckle of the bright middle rules the fit
    blind = errors(image, noise=SensorNoise(speckle=0.0, electrons_per_dn=np.inf))[0].std()
    assert blind > 1.3 * spread['gaussian']


@pytest.mark.parametrize('method', ['gaussian', 'log_gaussian'])
def test_clipped_pixels_are_left_out(method):
    u = columns()
    uv = np.stack([u, np.arange(ROWS, dtype=np.float64)], axis=1)
    image = expose(draw_stripe(uv, (ROWS, COLUMNS), peak=600.0, sigma=2.5))
    assert (image == 255).sum(axis=1).min() >= 4
    error, _ = errors(image, method=method, noise=SensorNoise(speckle=0.0))
    assert len(error) == ROWS
    assert np.abs(error).max() < 0.05


def test_unknown_method_is_refused():
    with pytest.raises(ParameterError, match=r"^method: 'steger' is not one of auto, paper"):
        ExtractSettings(method='steger')
