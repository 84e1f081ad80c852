# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.image_bits import require_image_bits
from ivfmc_ros.image_bits import require_known_bits
from ivfmc_ros.image_bits import to_full_scale


def image(*values):
    return np.array([values], dtype=np.uint16)


@pytest.mark.parametrize('bits', [8, 10, 12, 14])
def test_black_stays_black_and_full_scale_becomes_full_scale(bits):
    full = (1 << bits) - 1
    scaled = to_full_scale(image(0, full // 2, full), bits, 'x')
    assert scaled.dtype == np.uint16
    assert scaled[0, 0] == 0
    assert scaled[0, 1] == pytest.approx(65535 / 2, rel=0.01)
    assert scaled[0, 2] == 65535


def test_image_of_8_bits_or_of_all_bits_is_unchanged():
    byte = np.array([[0, 255]], dtype=np.uint8)
    assert to_full_scale(byte, 12, 'x') is byte
    word = image(0, 4095)
    assert to_full_scale(word, 16, 'x') is word
    assert to_full_scale(word, 0, 'x') is word


def test_value_that_needs_more_bits_is_refused():
    with pytest.raises(ParameterError, match='image 7 has 4096; set image_bits to 13 or more'):
        to_full_scale(image(4096), 12, 'image 7')


@pytest.mark.parametrize(('brightest', 'bits'), [(1000, 10), (4092, 12), (9001, 14)])
def test_images_that_look_like_fewer_bits_are_refused_with_their_number(brightest, bits):
    with pytest.raises(ParameterError) as error:
        require_known_bits([image(3, 17), image(5, brightest)], 0)
    assert f'brightest of 65535 is {brightest} in 2 pictures' in str(error.value)
    assert f'set extract.image_bits: {bits} ' in str(error.value)


def test_images_are_not_refused_where_the_bits_are_used_or_known():
    require_known_bits([image(3, 17000)], 0)
    require_known_bits([image(3, 17)], 16)
    require_known_bits([np.array([[3, 17]], dtype=np.uint8)], 0)
    require_known_bits([], 0)
    # 12 bits in the upper ones, in a dark picture
    require_known_bits([image(16, 32, 4080)], 0)


@pytest.mark.parametrize('bits', [-1, 1, 7, 17])
def test_number_of_bits_out_of_range_is_refused(bits):
    with pytest.raises(ParameterError, match='image_bits'):
        require_image_bits(bits)
