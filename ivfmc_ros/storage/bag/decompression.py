# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Decompresses what ``ros2 bag record --compression-mode`` wrote: whole files, or each message.

A file is decompressed into a temporary folder: its index has to be read, which a stream does not
allow. The folder is removed with the last object that refers to it.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
import tempfile
from weakref import WeakValueDictionary

import zstandard

from ivfmc_ros.errors import BagError
from ivfmc_ros.storage.bag.bag_file import Encoded

# rosbag2's mode 'file' adds the name of the format; the zstd program adds .zst.
SUFFIXES = ('.zstd', '.zst')
_CHUNK = 1 << 20  # bytes that are decompressed at a time
# First bytes of a frame of zstd (RFC 8878); CDR begins with a zero byte.
_FRAME = b'\x28\xb5\x2f\xfd'


@dataclass(frozen=True, kw_only=True, eq=False)
class FileContent:
    """
    The content of a bag file.

    source : the file as the caller named it
    path : the same, or its decompressed copy
    folder : is removed, with the copy in it, when it is not referred to any more
    """

    source: Path
    path: Path
    folder: tempfile.TemporaryDirectory[str] | None = None

    @contextmanager
    def named_errors(self) -> Iterator[None]:
        """Make a BagError of the block name the source instead of the copy."""
        try:
            yield
        except BagError as error:
            if self.path == self.source:
                raise
            raise BagError(self.named(str(error))) from error

    def named(self, text: str) -> str:
        """Return a message with the source instead of the copy."""
        return text.replace(str(self.path), str(self.source))


# Copies that are in use, by file, time and size: the last two tell a file that was replaced.
_copies: WeakValueDictionary[tuple[Path, int, int], FileContent] = WeakValueDictionary()


def is_compressed(file: Path) -> bool:
    """Return whether a file is compressed as a whole."""
    return file.name.endswith(SUFFIXES)


def plain_name(file: Path) -> str:
    """Return the name of a file without the suffix of a compression."""
    return file.stem if is_compressed(file) else file.name


def content_of(file: Path) -> FileContent:
    """
    Return the content of a bag file; one that is compressed as a whole is decompressed.

    What follows a damage is left out: the reader of the content finds that it ends early.

    :raises BagError: the file is not of zstd, cannot be read, or there is no room for its content
    """
    if not is_compressed(file):
        return FileContent(source=file, path=file)
    try:
        state = file.stat()
        key = file.resolve(), state.st_mtime_ns, state.st_size
        known = _copies.get(key)
        if known is None:
            known = _copies[key] = _decompress(file)
        return known
    except OSError as error:
        raise BagError(f'{file}: cannot be decompressed: {error.strerror or error}') from error


def plain_message(data: Encoded, topic: str, index: int) -> Encoded:
    """
    Return a message; one that is compressed by itself is decompressed.

    data : CDR, or a frame of zstd with CDR in it
    :raises BagError: the frame is damaged
    """
    if data[: len(_FRAME)] != _FRAME:
        return data
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


def _decompress(file: Path) -> FileContent:
    folder = tempfile.TemporaryDirectory(prefix='ivfmc_')
    target = Path(folder.name) / plain_name(file)
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
    return FileContent(source=file, path=target, folder=folder)
