# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A thin stripe beside and on a bright, broad fan of light that was reflected twice."""

import numpy as np
import pytest

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.stripe.extract import extract
from ivfmc_ros.stripe.extract import ExtractSettings
from ivfmc_ros.stripe.extract import rows_with_glare
from ivfmc_ros.stripe.glare import expected_width
from ivfmc_ros.stripe.glare import is_glaring

ROWS, COLUMNS = 240, 420
SIGMA = 1.1  # pixels, of the directly lit stripe
AMBIENT = 6.0
ON = ExtractSettings(glare='on')
EVERYTHING = ExtractSettings(max_uncertainty=50.0, max_error=50.0)


def picture(direct=100.0, fan=100.0, seed=1, sigma=SIGMA):
    """Return a picture with speckle and noise, and the columns of the stripe."""
    rng = np.random.default_rng(seed)
    rows, columns = np.arange(ROWS)[:, None], np.arange(COLUMNS)
    u = 150.0 + 0.25 * rows + 6.0 * np.sin(rows / 40.0)
    # the fan begins at a quarter of the rows, widens, and leaves the stripe
    along = np.clip((rows - 60.0) / 60.0, 0.0, 1.0)
    middle, breadth = u + 4.0 + 12.0 * along, 10.0 + 12.0 * along
    light = direct * np.exp(-0.5 * ((columns - u) / sigma) ** 2)
    light = light + fan * along / (1.0 + ((columns - middle) / breadth) ** 2) ** 2
    light = light * rng.gamma(0.15**-2, 0.15**2, light.shape)
    total = AMBIENT + light
    total = total + np.sqrt(4.0 + total / 45.0) * rng.standard_normal(total.shape)
    return np.clip(np.rint(total), 0, 255).astype(np.uint8), u[:, 0]


def errors(stripe, u):
    return stripe.uv[:, 0] - u[stripe.uv[:, 1].astype(int)]


def test_thin_stripe_is_found_beside_a_brighter_fan():
    image, u = picture()
    stripe = extract(image, settings=ON)
    error = errors(stripe, u)
    assert len(stripe) > 0.8 * ROWS
    assert np.abs(error).max() < 1.0
    assert np.sqrt(np.mean(error**2)) < 0.25
    before = extract(image, settings=ExtractSettings(glare='off'))
    assert np.count_nonzero(np.abs(errors(before, u)) < 1.0) < 0.6 * ROWS


def test_claimed_sigma_holds_beside_the_fan():
    scores = []
    for seed in range(4):
        image, u = picture(seed=seed)
        stripe = extract(image, settings=ON)
        scores.append(errors(stripe, u) / stripe.sigma)
    score = np.concatenate(scores)
    assert np.mean(np.abs(score) < 2.0) > 0.9


def test_fan_without_a_stripe_is_left_empty():
    image, _ = picture(direct=0.0)
    stripe = extract(image, settings=ExtractSettings(glare='on', expected_width=SIGMA))
    assert len(stripe) < 0.03 * ROWS


def test_columns_are_searched_like_rows():
    image, u = picture()
    stripe = extract(np.ascontiguousarray(image.T), 'columns', ON)
    assert np.abs(stripe.uv[:, 1] - u[stripe.uv[:, 0].astype(int)]).max() < 1.0
    assert len(stripe) > 0.8 * ROWS


def test_sixteen_bits_give_the_same_as_eight():
    image, _ = picture()
    few = extract(image, settings=ON)
    many = extract(image.astype(np.uint16) * 257, settings=ON)
    assert abs(len(few) - len(many)) <= 0.03 * ROWS


@pytest.mark.parametrize('sigma', [SIGMA, 2.5])
def test_only_a_fan_shows_glare(sigma):
    for fan in (0.0, 130.0):
        image, _ = picture(direct=150.0, fan=fan, sigma=sigma)
        found = extract(image, settings=EVERYTHING)
        glare = rows_with_glare(image, 'rows', EVERYTHING, None, found)
        assert is_glaring(glare) == bool(fan)
        assert expected_width(found.width) == pytest.approx(sigma, rel=0.15)


def test_other_estimators_are_left_alone():
    image, _ = picture()
    mass = extract(image, settings=ExtractSettings(method='centre_of_mass', glare='on'))
    before = extract(image, settings=ExtractSettings(method='centre_of_mass', glare='off'))
    np.testing.assert_array_equal(mass.uv, before.uv)


def test_unknown_choice_is_refused():
    with pytest.raises(ParameterError, match='glare'):
        ExtractSettings(glare='maybe')
    with pytest.raises(ParameterError, match='expected_width'):
        ExtractSettings(expected_width=0.0)


def test_black_picture_is_empty():
    black = np.zeros((ROWS, COLUMNS), dtype=np.uint8)
    assert not len(extract(black, settings=ExtractSettings(glare='on', expected_width=SIGMA)))
