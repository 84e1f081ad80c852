# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.model import Frame
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.parts.solids import demo_part
from ivfmc_ros.simulation.render.renderer import simulate_scan
from ivfmc_ros.stripe.acquisition import Acquisition
from ivfmc_ros.stripe.acquisition import AcquisitionSettings
from ivfmc_ros.stripe.ambient import noise_of_difference
from ivfmc_ros.stripe.ambient import subtract_ambient
from ivfmc_ros.stripe.noise import SensorNoise


def frame(image, dark=None):
    return Frame(image=image, stamp_ns=0, angle=0.0, dark=dark)


def test_without_a_dark_picture_nothing_changes():
    image = np.full((2, 2), 7, dtype=np.uint8)
    assert subtract_ambient(frame(image)) is image


@pytest.mark.parametrize('dtype', [np.uint8, np.uint16])
def test_clipped_pixels_stay_clipped_and_none_wraps(dtype):
    full = np.iinfo(dtype).max
    image = np.array([[full, 100, 20]], dtype=dtype)
    dark = np.array([[90, 30, 25]], dtype=dtype)
    assert subtract_ambient(frame(image, dark)).tolist() == [[full, 70, 0]]


def test_two_readings_are_noisier_than_one():
    assert noise_of_difference(SensorNoise(read=2.0)).read == pytest.approx(2.0 * 2.0**0.5)
    assert noise_of_difference(None).read > SensorNoise().read


def test_dark_image_of_another_shape_is_refused():
    with pytest.raises(ValueError, match='must have the same shape and type'):
        frame(np.zeros((2, 2), dtype=np.uint8), np.zeros((2, 3), dtype=np.uint8))


def test_lamp_that_looks_like_a_stripe_is_taken_away():
    cell = bench_cell()
    [lit] = simulate_scan(cell, demo_part(), 1, lasers=[0], seed=3)
    truth = Acquisition(cell, AcquisitionSettings()).profile(lit)
    # a bright edge of a lamp beside the stripe, stronger than it and as wide
    place = np.interp(np.arange(len(lit.image)), truth.uv[:, 1], truth.uv[:, 0]) - 30.0
    away = np.arange(lit.image.shape[1]) - place[:, None]
    lamp = (6.0 + 180.0 * np.exp(-0.5 * (away / 2.5) ** 2)).astype(np.uint8)
    both = np.minimum(lit.image.astype(int) + lamp, 255).astype(np.uint8)
    rng = np.random.default_rng(5)
    dark = np.clip(lamp + rng.normal(0.0, 2.0, lamp.shape), 0, 255).astype(np.uint8)

    def points(image, dark=None):
        made = Frame(image=image, stamp_ns=0, angle=lit.angle, laser=lit.laser, dark=dark)
        return Acquisition(cell, AcquisitionSettings()).profile(made)

    column = dict(zip(truth.uv[:, 1].astype(int), truth.uv[:, 0], strict=True))

    def wrong(profile):
        pairs = [(u, column[int(v)]) for u, v in profile.uv if int(v) in column]
        off = np.abs(np.diff(pairs, axis=1))
        return np.count_nonzero(off > 1.0) / len(truth)

    assert wrong(points(both)) > 0.3
    assert wrong(points(both, dark)) < 0.01
    assert len(points(both, dark)) > 0.95 * len(truth)
