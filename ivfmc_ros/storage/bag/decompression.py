# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Decompresses what ``ros2 bag record --compression-mode`` wrote: whole files, or each message.

A file is decompressed into a temporary folder that lives as long as the process: its index has to
be read, which a stream does not allow.
"""

import atexit
from functools import cache
from pathlib import Path
import tempfile

import zstandard

from ivfmc_ros.errors import BagError

# rosbag2's mode 'file' adds the name of the format; the zstd program adds .zst.
SUFFIXES = ('.zstd', '.zst')
_CHUNK = 1 << 20  # bytes that are decompressed at a time


def is_compressed(file: Path) -> bool:
    """Return whether a file is compressed as a whole."""
    return file.name.endswith(SUFFIXES)


def decompressed(file: Path) -> Path:
    """
    Return a file with the decompressed content of another one; the same for the same file.

    What follows a damage is left out: the reader of the content finds that it ends early.

    :raises BagError: the file is not of zstd, cannot be read, or there is no room for its content
    """
    try:
        state = file.stat()
        return _decompressed(file.resolve(), state.st_mtime_ns, state.st_size)
    except OSError as error:
        raise BagError(f'{file}: cannot be decompressed: {error.strerror or error}') from error


def decompress_message(data: bytes, topic: str, index: int) -> bytes:
    """
    Return the content of a message that is compressed by itself.

    :raises BagError: it is damaged, or not of zstd
    """
    frame = zstandard.ZstdDecompressor().decompressobj()
    try:
        content = frame.decompress(data)
        fault = '' if frame.eof else 'it ends early'
    except zstandard.ZstdError as error:
        fault = str(error)
    if fault:
        raise BagError(
            f'{topic}: message {index} cannot be decompressed by zstd ({fault}); copy the bag '
            'again'
        )
    return content


@cache
def _decompressed(file: Path, _modified_ns: int, _size: int) -> Path:
    """Return the decompressed file; the time and size tell a file that was replaced."""
    target = Path(tempfile.mkdtemp(dir=_folder())) / file.stem
    decompressor = zstandard.ZstdDecompressor()
    with file.open('rb') as source, target.open('wb') as stream:
        content = decompressor.stream_reader(source, read_across_frames=True)
        try:
            while chunk := content.read(_CHUNK):
                stream.write(chunk)
        except zstandard.ZstdError as error:
            fault = str(error)
        else:
            fault = 'it ends early'
        if not stream.tell():
            raise BagError(f'{file}: cannot be decompressed by zstd ({fault}); copy it again')
    return target


@cache
def _folder() -> str:
    folder = tempfile.TemporaryDirectory(prefix='ivfmc_')
    atexit.register(folder.cleanup)
    return folder.name
