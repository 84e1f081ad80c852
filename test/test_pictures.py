# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import cv2
import numpy as np
import pytest

from ivfmc_ros import pictures
from ivfmc_ros.errors import FileError


def _encoded(suffix='.jpg', shape=(48, 64, 3), dtype=np.uint8):
    random = np.random.default_rng(7)
    image = random.integers(0, np.iinfo(dtype).max, shape, dtype=dtype)
    return image, cv2.imencode(suffix, image)[1].tobytes()


def test_pictures_come_in_natural_order(tmp_path):
    for name in ('step10.jpg', 'step2.JPG', '1.png', 'b.tif', 'a1b2.bmp', 'a1b10.bmp'):
        (tmp_path / name).write_bytes(b'x')
    names = [path.name for path in pictures.list_pictures(tmp_path)]
    assert names == ['1.png', 'a1b2.bmp', 'a1b10.bmp', 'b.tif', 'step2.JPG', 'step10.jpg']


def test_other_and_hidden_files_do_not_count(tmp_path):
    for name in ('step1.jpg', '._step1.jpg', 'notes.txt'):
        (tmp_path / name).write_bytes(b'x')
    (tmp_path / 'folder.png').mkdir()
    assert [path.name for path in pictures.list_pictures(tmp_path)] == ['step1.jpg']


def test_empty_folder_is_named_and_suffixes_told(tmp_path):
    (tmp_path / 'notes.txt').touch()
    with pytest.raises(FileError, match=r'holds no picture.*\.jpg.*\.png') as caught:
        pictures.list_pictures(tmp_path)
    assert str(tmp_path) in str(caught.value)


def test_missing_folder_is_named(tmp_path):
    with pytest.raises(FileError, match='nowhere: the folder cannot be read: No such file'):
        pictures.list_pictures(tmp_path / 'nowhere')


@pytest.mark.parametrize('shape', [(48, 64), (48, 64, 3)])
@pytest.mark.parametrize('dtype', [np.uint8, np.uint16])
def test_png_comes_back_as_it_was(tmp_path, shape, dtype):
    image, data = _encoded('.png', shape, dtype)
    (tmp_path / 'p.png').write_bytes(data)
    read = pictures.read_picture(tmp_path / 'p.png')
    assert read.dtype == dtype
    np.testing.assert_array_equal(read, image)


def test_alpha_is_left_away():
    image, data = _encoded('.png', (8, 9, 4))
    np.testing.assert_array_equal(pictures.decode_picture(data, 'p'), image[..., :3])


@pytest.mark.parametrize('keep', [2, 20, 300, -1, -2, -400])
def test_truncated_jpeg_is_named(tmp_path, keep):
    _, data = _encoded()
    (tmp_path / 'cut.jpg').write_bytes(data[:keep])
    with pytest.raises(FileError, match=r'cut\.jpg: the picture is cut off after \d+ bytes'):
        pictures.read_picture(tmp_path / 'cut.jpg')


def test_jpeg_that_ends_in_zeros_is_cut_off():
    _, data = _encoded()
    with pytest.raises(FileError, match='cut off'):
        pictures.decode_picture(data[:-500] + bytes(500), 'p')


def test_bytes_after_the_end_of_a_jpeg_are_allowed():
    image, data = _encoded()
    assert pictures.decode_picture(data + b'\0\0garbage', 'p').shape == image.shape


def test_end_mark_of_a_thumbnail_is_not_the_end():
    _, data = _encoded()
    thumbnail = b'Exif\0\0' + data
    header = b'\xff\xe1' + (len(thumbnail) + 2).to_bytes(2, 'big')
    whole = data[:2] + header + thumbnail + data[2:]
    pictures.decode_picture(whole, 'p')
    with pytest.raises(FileError, match='cut off'):
        pictures.decode_picture(whole[:-10], 'p')


@pytest.mark.parametrize('keep', [100, -1, -12])
def test_truncated_png_is_refused_before_a_library_writes_on_stderr(capfd, keep):
    _, data = _encoded('.png')
    with pytest.raises(FileError, match='p: the picture is cut off'):
        pictures.decode_picture(data[:keep], 'p')
    assert capfd.readouterr().err == ''


def test_empty_file_is_cut_off():
    with pytest.raises(FileError, match='cut off after 0 bytes'):
        pictures.decode_picture(b'', 'p')


def test_file_that_is_no_picture_is_named(tmp_path):
    (tmp_path / 'text.jpg').write_text('hello')
    with pytest.raises(FileError, match=r'text\.jpg: cannot be decoded as a picture'):
        pictures.read_picture(tmp_path / 'text.jpg')


def test_float_pixels_are_refused():
    data = cv2.imencode('.tiff', np.zeros((4, 5), np.float32))[1].tobytes()
    with pytest.raises(FileError, match='pixels are float32'):
        pictures.decode_picture(data, 'p')


def test_missing_picture_is_named(tmp_path):
    with pytest.raises(FileError, match=r'gone\.jpg: cannot be read: No such file'):
        pictures.read_picture(tmp_path / 'gone.jpg')
