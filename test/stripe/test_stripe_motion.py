# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.stripe.stripe_motion import StripeMotion
from ivfmc_ros.stripe.stripe_motion import StripeRate

MS = 1_000_000
HEIGHT, WIDTH = 200, 300
SPECKLE = np.random.default_rng(5).uniform(0.5, 1.5, (HEIGHT, WIDTH))


def picture(shift=0.0, seed=0, height=120.0, lines=HEIGHT, bits=8):
    """A stripe of 2 pixels, 1 sigma, that leans; its speckle stays where it is."""
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    center = 120.0 + 0.2 * v + shift
    light = height * np.exp(-0.5 * ((u - center) / 2.0) ** 2) * SPECKLE
    light[lines:] = 0.0
    noise = np.random.default_rng(seed).normal(0.0, 2.0, light.shape)
    scale = 1 if bits == 8 else 257
    kind = np.uint8 if bits == 8 else np.uint16
    return (np.clip(np.round(10.0 + light + noise), 0, 255) * scale).astype(kind)


def followed(shifts, period_ms=33, picture=picture, **values):
    motion = StripeMotion()
    for number, shift in enumerate(shifts):
        image = picture(shift, seed=number, **values)
        motion.add(image, 1, 0.3, number * period_ms * MS)
    return motion


@pytest.mark.parametrize('values', [{}, {'bits': 16}, {'lines': 60}])
def test_rate_is_that_of_the_stripe_within_its_uncertainty(values):
    found = followed(0.004 * np.arange(90), **values).rate
    assert found.laser == 1
    assert found.seconds == pytest.approx(88 * 0.033, abs=1e-6)
    assert found.u < 0.006
    assert found.rate == pytest.approx(0.004 / 0.033, abs=3.0 * found.u + 0.05 * 0.12)


def test_stripe_that_stands_has_no_rate_beyond_its_uncertainty():
    found = followed(np.zeros(150)).rate
    assert abs(found.rate) < 3.0 * found.u
    assert found.greatest_shift(10.0) < 0.05


def test_stripe_along_the_columns_of_a_color_image():
    def turned(shift, seed):
        return np.repeat(picture(shift, seed).T[..., None], 3, axis=2)

    motion = followed(0.01 * np.arange(30), picture=turned)
    assert motion.last.pixels == pytest.approx(0.29, abs=0.03)


def test_shift_of_one_image_has_an_uncertainty():
    motion = followed([0.0, 0.4])
    assert motion.last.pixels == pytest.approx(0.4, abs=5.0 * motion.last.u)
    assert motion.last.u < 0.03
    assert motion.rate is None


@pytest.mark.parametrize(
    ('laser', 'angle', 'stamp_ms'), [(0, 0.3, 66), (1, 0.31, 66), (1, 0.3, 9000)]
)
def test_another_laser_angle_or_a_pause_begins_anew(laser, angle, stamp_ms):
    motion = followed(np.zeros(20))
    assert motion.rate is not None
    motion.add(picture(), laser, angle, (20 * 33 + stamp_ms) * MS)
    assert motion.rate is None
    assert motion.last is None


def test_only_the_last_seconds_count():
    # a laser that was cold for the first half of 40 s
    shifts = np.concatenate([0.01 * np.arange(200), np.full(210, 2.0)])
    found = followed(shifts, period_ms=100).rate
    assert found.seconds == pytest.approx(20.0, abs=0.2)
    assert abs(found.rate) < 1e-3


def test_laser_that_was_cold_some_seconds_ago_rests_now():
    shifts = np.concatenate([0.01 * np.arange(200), np.full(60, 2.0)])
    found = followed(shifts, period_ms=100).rate
    assert found.seconds == pytest.approx(5.0, abs=0.2)
    assert abs(found.rate) < 3.0 * found.u < 0.01


def test_images_without_a_stripe_have_no_shift():
    motion = followed([0.0, 0.0], height=0.0)
    assert motion.last is None
    assert motion.rate is None
    assert followed([0.0, 0.0], lines=10).last is None


def test_greatest_shift_counts_the_uncertainty():
    rate = StripeRate(laser=0, seconds=5.0, rate=-0.01, u=0.002)
    assert rate.greatest_shift(10.0) == pytest.approx(0.14)
