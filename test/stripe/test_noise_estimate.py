# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from support.synthetic import draw_stripe
from support.synthetic import expose

from ivfmc_ros.errors import CalibrationError
from ivfmc_ros.stripe.extract import ExtractSettings
from ivfmc_ros.stripe.noise import SensorNoise
from ivfmc_ros.stripe.noise_estimate import estimate_noise

SHAPE = (400, 120)


def pictures(speckle, peaks=(60.0, 120.0, 180.0)):
    rng = np.random.default_rng(1)
    uv = np.stack([60.0 + np.linspace(-9, 9, SHAPE[0]), np.arange(SHAPE[0])], axis=1)
    return [expose(draw_stripe(uv, SHAPE, peak=p), rng, speckle=speckle) for p in peaks]


@pytest.mark.parametrize('speckle', [0.0, 0.1, 0.15])
def test_noise_of_the_camera_is_found(speckle):
    made = estimate_noise(pictures(speckle), ExtractSettings())
    truth = SensorNoise(speckle=speckle)
    assert made.noise.speckle == pytest.approx(speckle, abs=0.02)
    # shot noise and read noise are hard to tell apart; what counts is the variance
    total, laser = np.array([6.0, 30.0, 60.0, 150.0]), np.array([0.0, 24.0, 54.0, 144.0])
    found = np.sqrt(made.noise.variance(total, laser))
    assert found == pytest.approx(np.sqrt(truth.variance(total, laser)), rel=0.15)
    assert made.shape < 0.02


def test_stripe_that_is_no_bell_is_told():
    flat = [np.minimum(image, 90) for image in pictures(0.05)]
    assert estimate_noise(flat, ExtractSettings()).shape > 0.03


def test_dark_pictures_are_refused():
    dark = [np.full(SHAPE, 6, dtype=np.uint8)] * 2
    with pytest.raises(CalibrationError, match=r'^noise: 0 pixels of a stripe in 2 images'):
        estimate_noise(dark, ExtractSettings())
