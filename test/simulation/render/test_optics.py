# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.simulation.render.optics import add_speckle
from ivfmc_ros.simulation.render.optics import expose
from ivfmc_ros.simulation.render.optics import Optics
from ivfmc_ros.simulation.render.optics import sheet_sigma
from ivfmc_ros.simulation.render.optics import stripe_profile

SHAPE = (400, 500)


def flat(signal):
    return np.full(SHAPE, signal, dtype=np.float32)


@pytest.mark.parametrize('signal', [0.0, 20.0, 80.0, 120.0])
def test_variance_is_the_model_of_the_sensor(signal):
    optics = Optics(ambient=20.0)
    picture = expose(optics.ambient, flat(signal), optics, np.random.default_rng(1)).astype(float)
    rounding = 1 / 12
    variance = 2.0**2 + (20.0 + signal) / 45 + (0.15 * signal) ** 2 + rounding
    # 200,000 samples give a variance within 1 %
    assert picture.var() == pytest.approx(variance, rel=0.02)
    assert picture.mean() == pytest.approx(20 + signal, abs=0.1)


def test_pixels_are_independent():
    optics = Optics()
    picture = expose(6.0, flat(100.0), optics, np.random.default_rng(2)).astype(float)
    deviation = picture - picture.mean()
    for neighbors in (deviation[:, 1:] * deviation[:, :-1], deviation[1:] * deviation[:-1]):
        assert abs(neighbors.mean() / picture.var()) < 0.01


@pytest.mark.parametrize(
    ('off', 'variance'),
    [
        ({'read_noise': 0.0}, 106 / 45 + 15**2),
        ({'electrons_per_dn': math.inf}, 4 + 15**2),
        ({'speckle': 0.0}, 4 + 106 / 45),
    ],
)
def test_each_noise_can_be_switched_off(off, variance):
    picture = expose(6.0, flat(100.0), Optics(**off), np.random.default_rng(3)).astype(float)
    assert picture.var() == pytest.approx(variance + 1 / 12, rel=0.02)


def test_without_noise_a_picture_is_its_light():
    picture = expose(6.0, flat(100.3), Optics().without_noise(), np.random.default_rng(4))
    assert np.unique(picture).tolist() == [106]


def test_bright_light_saturates():
    picture = expose(6.0, flat(400.0), Optics().without_noise(), np.random.default_rng(5))
    assert picture.dtype == np.uint8
    assert np.unique(picture).tolist() == [255]


def test_speckle_never_takes_more_light_than_there_is():
    light = add_speckle(flat(10.0), 0.6, np.random.default_rng(6))
    assert light.min() >= 0
    assert light.mean() == pytest.approx(10, rel=0.01)


def test_profile_is_the_mean_over_the_pixel():
    sigma, footprint = 3e-4, np.array([4e-4])
    for center in (0.0, 1e-4, 5e-4):
        inside = center + footprint * (np.arange(1000) + 0.5) / 1000 - footprint / 2
        mean = np.exp(-0.5 * (inside / sigma) ** 2).mean()
        assert stripe_profile(np.array([center]), footprint, sigma) == pytest.approx(mean, 1e-5)


def test_profile_of_a_fine_pixel_is_the_gaussian():
    distance = np.linspace(-1e-3, 1e-3, 41)
    expected = np.exp(-0.5 * (distance / 3e-4) ** 2)
    assert stripe_profile(distance, np.zeros(41), 3e-4) == pytest.approx(expected, abs=1e-6)


def test_sheet_gives_the_stripe_asked_for(cell):
    sigma = sheet_sigma(cell, cell.lasers[0], Optics(stripe_sigma=2.5))
    # a surface that faces the camera at the axis: sideways motion is 0.17 mm a pixel there
    assert sigma == pytest.approx(2.5 * 0.4 / 2350 * np.cos(np.radians(36)))


@pytest.mark.parametrize(
    'wrong',
    [
        {'stripe_sigma': 0.0},
        {'electrons_per_dn': -1.0},
        {'peak': -1.0},
        {'read_noise': math.nan},
        {'speckle': -0.1},
        {'ambient': math.inf},
    ],
)
def test_impossible_optics_are_refused(wrong):
    with pytest.raises(ParameterError, match=next(iter(wrong))):
        Optics(**wrong)
