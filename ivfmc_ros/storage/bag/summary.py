# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reads the summary section of an MCAP file, its index of topics, and checks its CRC."""

import os
from pathlib import Path
import struct
from typing import IO
import zlib

from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.summary import Summary
import zstandard

from ivfmc_ros.storage.bag.mcap_layout import MAGIC

# Footer record: opcode, length, start of the summary, start of its offsets, CRC.
_FOOTER = struct.Struct('<BQQQI')
_CRC_SIZE = 4
# Bytes that are read at a time: a wrong offset must not need the memory of the whole file.
_BLOCK = 1024 * 1024

# Exceptions of the mcap library on damaged files; lz4 raises RuntimeError, a wrong CRC ValueError.
READ_ERRORS = (
    McapError,
    zstandard.ZstdError,
    struct.error,
    ValueError,
    KeyError,
    RuntimeError,
    OverflowError,
    MemoryError,
)


def is_cut_off(file: Path) -> bool:
    """Return whether a file does not end with the magic bytes of MCAP."""
    if file.stat().st_size < 2 * len(MAGIC):
        return True
    with file.open('rb') as stream:
        stream.seek(-len(MAGIC), os.SEEK_END)
        return stream.read() != MAGIC


def read_summary(file: Path) -> tuple[Summary | None, str]:
    """
    Read the index at the end of a file.

    An index without a CRC is not returned either: one wrong bit in it can hide a topic.

    :returns: the index, or None where there is none that can be trusted; and a description of its
        damage, '' where it has none
    """
    damage = f'{file}: the index at the end of the file is damaged; the messages are read instead'
    if is_cut_off(file):
        return None, damage
    try:
        with file.open('rb') as stream:
            crc, computed = _crcs(stream)
            if not crc:
                return None, ''
            if computed != crc:
                return None, damage
            stream.seek(0)
            return make_reader(stream).get_summary(), ''
    except (*READ_ERRORS, OSError):
        return None, damage


def _crcs(stream: IO[bytes]) -> tuple[int, int]:
    """Return the CRC in the footer, 0 where there is none, and that of the summary section."""
    end = stream.seek(-len(MAGIC), os.SEEK_END)
    stream.seek(end - _FOOTER.size)
    _, _, start, _, crc = _FOOTER.unpack(stream.read(_FOOTER.size))
    if not crc:
        return 0, 0
    if not 0 < start < end:
        raise ValueError('the summary section begins outside of the file')
    # the CRC covers the summary section and the footer up to the CRC itself
    stream.seek(start)
    computed = 0
    left = end - _CRC_SIZE - start
    while left > 0 and (data := stream.read(min(left, _BLOCK))):
        computed = zlib.crc32(data, computed)
        left -= len(data)
    return crc, computed
