# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from support.synthetic import draw_stripe

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.stripe import channel


def colored(blue, green, red, *, full=255):
    """A stripe with a peak of each color as a share of full scale, clipped."""
    uv = np.stack([np.full(80, 40.2), np.arange(80.0)], axis=1)
    shape = draw_stripe(uv, (80, 90), peak=1.0, ambient=0.0)
    light = np.stack([shape * blue, shape * green, shape * red], axis=2).clip(0, 1) * full
    return np.rint(light).astype(np.uint8 if full == 255 else np.uint16)


@pytest.mark.parametrize('full', [255, 65535])
def test_color_that_saturates_is_left_out(full):
    assert channel.unclipped_channel([colored(0.4, 1.6, 0.6, full=full)]) == 'blue+red'


def test_colors_that_do_not_saturate_count_together():
    assert channel.unclipped_channel([colored(0.4, 0.9, 0.6)]) == 'blue+green+red'


def test_least_clipped_color_counts_when_all_are_clipped():
    image = colored(2.0, 2.0, 2.0)
    image[20:, :, 2] = colored(0.0, 0.0, 0.8)[20:, :, 2]
    image[60:, :, 0] = 0
    assert channel.unclipped_channel([image]) == 'red'


def test_dark_pictures_do_not_dilute_the_clipped_ones():
    dark = np.full((80, 90, 3), 5, dtype=np.uint8)
    pictures = [dark] * 15 + [colored(0.4, 1.6, 0.6)]
    assert channel.unclipped_channel(pictures) == 'blue+red'


def test_a_few_clipped_rows_do_no_harm():
    image = colored(0.4, 0.8, 0.6)
    image[:4, 40, 1] = 255
    assert channel.unclipped_channel([image]) == 'blue+green+red'


@pytest.mark.parametrize('pictures', [[], [np.zeros((8, 9), dtype=np.uint8)]])
def test_without_colors_there_is_nothing_to_choose(pictures):
    assert channel.unclipped_channel(pictures) == 'blue+green+red'


def test_channel_is_the_mean_of_its_colors():
    image = np.zeros((2, 2, 3), dtype=np.uint8)
    image[...] = (10, 40, 100)
    assert (channel.to_gray(image, 'green') == 40).all()
    assert (channel.to_gray(image, 'blue+red') == 55).all()
    assert (channel.to_gray(image, 'blue+green+red') == 50).all()
    assert channel.to_gray(image, 'red').dtype == np.uint8
    assert (channel.to_gray(image.astype(np.uint16) * 257, 'red') == 25700).all()


def test_mono_stays_as_it_is():
    image = np.arange(6, dtype=np.uint8).reshape(2, 3)
    assert channel.to_gray(image, 'red') is image


def test_weights_are_in_the_order_of_opencv():
    assert channel.channel_weights('blue').tolist() == [1, 0, 0]
    assert channel.channel_weights('red+green').tolist() == [0, 0.5, 0.5]


def test_unknown_color_is_refused():
    with pytest.raises(ParameterError, match=r"channel: 'violet' must be .* blue, green, red"):
        channel.channel_weights('violet')
