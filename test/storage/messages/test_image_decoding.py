# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from array import array
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from ivfmc_ros.errors import BagError
from ivfmc_ros.errors import FileError
from ivfmc_ros.storage.messages import sensor_messages
from ivfmc_ros.storage.messages.image_decoding import decode_compressed
from ivfmc_ros.storage.messages.image_decoding import decode_image


def _message(encoding, pixels, *, step=None, big=False, size=None):
    pixels = np.asarray(pixels)
    height, width = size or pixels.shape[:2]
    return SimpleNamespace(
        encoding=encoding,
        height=height,
        width=width,
        step=pixels.nbytes // height if step is None else step,
        is_bigendian=big,
        data=np.frombuffer(pixels.tobytes(), np.uint8),
    )


def _random(*shape, dtype=np.uint8):
    return np.random.default_rng(3).integers(0, np.iinfo(dtype).max, shape, dtype=dtype)


@pytest.mark.parametrize(
    ('shape', 'dtype'),
    [
        ((6, 8), np.uint8),
        ((6, 8), np.uint16),
        ((6, 8, 3), np.uint8),
        ((6, 8, 3), np.uint16),
    ],
)
def test_written_image_is_read_unchanged(shape, dtype):
    image = _random(*shape, dtype=dtype)
    read = decode_image(sensor_messages.image(0, image), 'x')
    assert read.dtype == dtype
    np.testing.assert_array_equal(read, image)


@pytest.mark.parametrize(
    ('encoding', 'order'),
    [
        ('bgr8', [0, 1, 2]),
        ('8UC3', [0, 1, 2]),
        ('rgb8', [2, 1, 0]),
        ('bgra8', [0, 1, 2]),
        ('rgba8', [2, 1, 0]),
    ],
)
def test_colors_are_returned_as_bgr(encoding, order):
    pixels = _random(6, 8, 4 if 'a' in encoding else 3)
    image = decode_image(_message(encoding, pixels), 'x')
    np.testing.assert_array_equal(image, pixels[..., order])


def test_rgb16_is_returned_as_bgr():
    pixels = _random(6, 8, 3, dtype=np.uint16)
    np.testing.assert_array_equal(decode_image(_message('rgb16', pixels), 'x'), pixels[..., ::-1])


def test_big_endian_mono16():
    pixels = _random(6, 8, dtype=np.uint16)
    image = decode_image(_message('mono16', pixels.astype('>u2'), big=True), 'x')
    np.testing.assert_array_equal(image, pixels)
    assert image.dtype.isnative


def test_rows_may_be_padded():
    pixels = _random(6, 10)
    image = decode_image(_message('mono8', pixels, step=10, size=(6, 8)), 'x')
    np.testing.assert_array_equal(image, pixels[:, :8])


def test_step_may_be_left_out():
    pixels = _random(6, 8)
    np.testing.assert_array_equal(decode_image(_message('mono8', pixels, step=0), 'x'), pixels)


def test_array_of_a_live_message_is_read():
    message = _message('mono8', np.zeros((6, 8), np.uint8))
    message.data = array('B', bytes(range(48)))
    assert decode_image(message, 'x')[0, 7] == 7


@pytest.mark.parametrize('pattern', ['rggb', 'bggr', 'gbrg', 'grbg'])
@pytest.mark.parametrize('dtype', [np.uint8, np.uint16])
@pytest.mark.parametrize(('color', 'channel'), [('b', 0), ('g', 1), ('r', 2)])
def test_bayer_patterns_keep_their_colors(pattern, dtype, color, channel):
    lit = np.array([letter == color for letter in pattern]).reshape(2, 2)
    mosaic = np.tile(lit, (8, 8)).astype(dtype) * 200
    image = decode_image(_message(f'bayer_{pattern}{mosaic.itemsize * 8}', mosaic), 'x')
    inner = image[4:-4, 4:-4]
    assert (inner[..., channel] == 200).all()
    assert not np.delete(inner, channel, axis=2).any()


@pytest.mark.parametrize('encoding', ['uyvy', 'yuv422', 'yuv422_yuy2', 'yuyv'])
def test_yuv_keeps_color_and_brightness(encoding):
    green = np.full((6, 8, 3), (40, 180, 60), np.uint8)
    y, u, v = cv2.split(cv2.cvtColor(green, cv2.COLOR_BGR2YUV))
    # video range, as cameras send it
    luma = (16 + y[:, ::2] * (219 / 255)).astype(np.uint8)
    parts = [u[:, ::2], luma, v[:, ::2], luma]
    if encoding not in ('uyvy', 'yuv422'):
        parts = [luma, u[:, ::2], luma, v[:, ::2]]
    pixels = np.stack(parts, axis=2).reshape(6, 8, 2)
    image = decode_image(_message(encoding, pixels), 'x')
    assert image.shape == (6, 8, 3)
    assert image[..., 1].min() > image[..., [0, 2]].max() + 80


@pytest.mark.parametrize('change', [{'height': 7}, {'width': 9}, {'step': 7}, {'width': 0}])
def test_wrong_size_is_named(change):
    message = _message('mono8', _random(6, 8))
    vars(message).update(change)
    with pytest.raises(BagError, match=r'^/cam, image 3: 48 bytes in rows of \d are not a'):
        decode_image(message, '/cam, image 3')


def test_unknown_encoding_is_named():
    with pytest.raises(BagError, match="encoding '32FC1' is not one of mono8"):
        decode_image(_message('32FC1', np.zeros((6, 8), np.float32)), 'x')


def test_yuv_of_odd_width_is_named():
    with pytest.raises(BagError, match='7 x 6 pixels are not a uyvy image'):
        decode_image(_message('uyvy', _random(6, 7, 2)), 'x')


@pytest.mark.parametrize('suffix', ['.jpg', '.png'])
def test_compressed_images_are_decoded(suffix):
    image = cv2.GaussianBlur(_random(48, 64), (9, 9), 0)
    data = cv2.imencode(suffix, image)[1].tobytes()
    read = decode_compressed(sensor_messages.compressed_image(0, data, suffix[1:]), 'x')
    np.testing.assert_allclose(read, image, atol=0 if suffix == '.png' else 12)


def test_truncated_jpeg_is_named():
    data = cv2.imencode('.jpg', _random(48, 64))[1].tobytes()[:-100]
    with pytest.raises(FileError, match=r'^/cam, image 3: the picture is cut off'):
        decode_compressed(sensor_messages.compressed_image(0, data, 'jpeg'), '/cam, image 3')


def test_other_compression_is_named():
    message = sensor_messages.compressed_image(0, b'\x1f\x8b123', '16UC1; compressedDepth rvl')
    with pytest.raises(BagError, match="format '16UC1; compressedDepth rvl' cannot be read"):
        decode_compressed(message, 'x')
