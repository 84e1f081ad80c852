# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Picture files: listing of a folder, and decoding that refuses truncated files."""

from collections.abc import Sequence
from pathlib import Path
import re
from typing import cast

import cv2
import numpy as np

from ivfmc_ros import files
from ivfmc_ros.errors import FileError
from ivfmc_ros.model import Image

# Largest picture file, bytes: an uncompressed one of 16 megapixels, 16 bits and three colors
# has 96 MiB.
_MAX_BYTES = 512 * 1024 * 1024

SUFFIXES = ('.jpg', '.jpeg', '.png', '.bmp', '.tif', '.tiff')

_JPEG_START = b'\xff\xd8'
_JPEG_END = b'\xff\xd9'
_JPEG_SCAN = 0xDA
_PNG_START = b'\x89PNG\r\n\x1a\n'
_PNG_END = b'IEND\xaeB`\x82'

# Pixels in the order of the sensor: an EXIF orientation must not rotate a picture, because the
# calibration holds for the sensor.
_DECODE_FLAGS = cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION


def natural_key(name: str) -> list[tuple[int, str]]:
    """Return a key for natural sorting, which orders step2 before step10."""
    # re.split returns the captured digits at odd indices
    parts = re.split(r'([0-9]+)', name)
    return [(int(part), '') if odd % 2 else (-1, part) for odd, part in enumerate(parts)]


def list_pictures(folder: Path) -> list[Path]:
    """
    Return the pictures of a folder in natural order.

    :raises FileError: the folder cannot be read or holds no picture
    """
    try:
        entries = list(folder.iterdir())
    except OSError as error:
        raise FileError(
            f'{folder}: the folder cannot be read: {error.strerror or error}'
        ) from error
    pictures = [path for path in entries if _is_picture(path)]
    if not pictures:
        raise FileError(f'{folder}: holds no picture; what counts are {", ".join(SUFFIXES)} files')
    return sorted(pictures, key=lambda path: natural_key(path.name))


def list_picture_tree(folders: Sequence[Path]) -> list[Path]:
    """
    Return the pictures of folders and of all folders in them, in natural order.

    :raises FileError: a folder cannot be read, or there is no picture
    """
    pictures = []
    for folder in folders:
        if not folder.is_dir():
            raise FileError(f'{folder}: the folder cannot be read: there is none of this name')
        pictures += [path for path in folder.rglob('*') if _is_picture(path)]
    if not pictures:
        raise FileError(
            f'{", ".join(map(str, folders))}: no picture in it; what counts are '
            f'{", ".join(SUFFIXES)} files'
        )
    return sorted(dict.fromkeys(pictures), key=lambda path: natural_key(str(path)))


def _is_picture(path: Path) -> bool:
    hidden = path.name.startswith('.')
    return not hidden and path.suffix.lower() in SUFFIXES and path.is_file()


def read_bytes(path: Path) -> bytes:
    """:raises FileError: the file cannot be read, is no regular file, or is too large."""
    return files.read_bytes(path, _MAX_BYTES)


def read_picture(path: Path) -> Image:
    """
    Read a picture file.

    returns : (height, width) mono or (height, width, 3) BGR, uint8 or uint16, not rotated by EXIF
    :raises FileError: the file cannot be read, is truncated, or is no picture
    """
    return decode_picture(read_bytes(path), str(path))


def decode_picture(data: bytes, where: str) -> Image:
    """
    Decode the bytes of a picture file; the message of an error begins with ``where``.

    returns : (height, width) mono or (height, width, 3) BGR, uint8 or uint16, not rotated by EXIF
    :raises FileError: the data are truncated or no picture
    """
    if _is_truncated(data):
        raise FileError(f'{where}: the picture is cut off after {len(data)} bytes; copy it again')
    try:
        image = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), _DECODE_FLAGS)
    except cv2.error:
        image = None
    if image is None:
        raise FileError(f'{where}: cannot be decoded as a picture')
    if image.dtype not in (np.uint8, np.uint16):
        raise FileError(f'{where}: pixels are {image.dtype}; pictures have 8 or 16 bits')
    return cast(Image, image)


def is_jpeg(data: bytes) -> bool:
    """Return whether the data begin with the signature of a JPEG file."""
    return data.startswith(_JPEG_START)


def is_png(data: bytes) -> bool:
    """Return whether the data begin with the signature of a PNG file."""
    return data.startswith(_PNG_START)


def _is_truncated(data: bytes) -> bool:
    # OpenCV 4 fills the missing part of a truncated JPEG with gray, and libjpeg and libpng write
    # warnings to stderr: the end marker is searched before they get the data
    if is_jpeg(data):
        return data.find(_JPEG_END, _scan_offset(data)) < 0
    if is_png(data):
        return _PNG_END not in data
    return not data


def _scan_offset(data: bytes) -> int:
    """Return the offset of a JPEG's scan; a thumbnail before it has its own end marker."""
    offset = len(_JPEG_START)
    while offset + 4 <= len(data) and data[offset] == 0xFF:
        if data[offset + 1] == _JPEG_SCAN:
            return offset
        if data[offset + 1] == 0xFF:  # padding before a marker
            offset += 1
            continue
        offset += 2 + int.from_bytes(data[offset + 2 : offset + 4], 'big')
    return len(data)
