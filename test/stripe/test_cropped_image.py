# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from support.synthetic import draw_stripe
from support.synthetic import expose

from ivfmc_ros.stripe.cropped_image import CroppedImage
from ivfmc_ros.stripe.cropped_image import dark_statistics
from ivfmc_ros.stripe.roi import RegionOfInterest
from ivfmc_ros.stripe.settings import ExtractSettings

ROWS = np.arange(100.0)


def stripe():
    return draw_stripe(np.stack([np.full(100, 200.0), ROWS], axis=1), (100, 400), peak=150.0)


@pytest.mark.parametrize('deviation', [1.0, 2.0, 5.0])
@pytest.mark.parametrize('lit', [False, True])
def test_noise_and_darkness_of_a_picture_are_found_beside_the_stripe(deviation, lit):
    image = stripe() if lit else np.full((100, 400), 6.0)
    base = np.full(image.shape, 20.0) + 200.0 * (image > 60)
    noisy = base + np.random.default_rng(2).normal(0.0, deviation, image.shape)
    noise, dark = dark_statistics(np.rint(noisy).clip(0, 255).astype(np.uint8), 'red')
    assert noise == pytest.approx(np.hypot(deviation, 0.29), rel=0.2)
    assert dark == pytest.approx(20.0, abs=0.5 * deviation)


@pytest.mark.parametrize('direction', ['rows', 'columns'])
@pytest.mark.parametrize('color', [False, True])
def test_part_is_cut_from_the_turned_picture(direction, color):
    image = expose(stripe())
    mask = np.zeros(image.shape, dtype=bool)
    mask[30:50, 190:210] = True
    upright = image[30:50, 190 - 59 : 210 + 59]
    if direction == 'columns':
        image, mask = np.swapaxes(image, 0, 1).copy(), mask.T
    if color:
        image = np.stack([image // 2, image, image // 3], axis=2)
    settings = ExtractSettings(channel='green')
    part = CroppedImage.of(image, direction, settings, RegionOfInterest.of(mask))
    assert np.array_equal(part.gray, upright)
    assert (part.first, part.columns) == ((30, 131), 400)
    assert part.mask.shape == upright.shape
    assert (part.mask.sum(), part.mask[:, 59:-59].min()) == (255 * 20 * 20, 255)
    whole = CroppedImage.of(image, direction, settings)
    assert (part.noise, part.dark) == (whole.noise, whole.dark)
    assert (whole.first, whole.gray.shape) == ((0, 0), (100, 400))


def test_sixteen_bits_are_scaled_to_eight():
    image = expose(stripe()).astype(np.uint16) * 257
    part = CroppedImage.of(image, 'rows', ExtractSettings())
    assert part.scale * part.gray.max() == pytest.approx(expose(stripe()).max())
