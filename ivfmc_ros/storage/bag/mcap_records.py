# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Iterates schemas, channels and messages of an MCAP file from its beginning (https://mcap.dev/spec).

The mcap library does the same with two CRCs and two more copies of every picture of a scan, and
parses all indices. Here indices are passed over, the CRC of an uncompressed chunk is a part of
that of the data section, and a picture, which fills its chunk, is a view of it.
"""

from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
import struct
import zlib

from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.exceptions import InvalidMagic
from mcap.opcode import Opcode
from mcap.records import Channel
from mcap.records import Chunk
from mcap.records import Schema
from mcap.stream_reader import get_chunk_data_stream

from ivfmc_ros.storage.bag.bag_file import Encoded
from ivfmc_ros.storage.bag.crc32 import combined_crc
from ivfmc_ros.storage.bag.mcap_layout import CHUNK
from ivfmc_ros.storage.bag.mcap_layout import HEAD
from ivfmc_ros.storage.bag.mcap_layout import MAGIC

# Size of the data of a chunk.
_SIZE = struct.Struct('<Q')
# Message before its data: channel, sequence, log time and publish time.
_MESSAGE = struct.Struct('<HIQQ')
_CRC = struct.Struct('<I')

# Channel id, log time in nanoseconds, and data.
ChunkMessage = tuple[int, int, Encoded]
Record = Schema | Channel | ChunkMessage


def file_records(file: Path, *, validate_crcs: bool) -> Iterator[Record]:
    """
    Yield the schemas, channels and messages of a file in the order in which they were written.

    validate_crcs : those of the chunks and of the data section
    :raises McapError, ValueError, struct.error: the file is cut off or damaged; what the libraries
        for compression raise, see ``summary.READ_ERRORS``
    """
    size = file.stat().st_size
    with file.open('rb') as stream:
        magic = stream.read(len(MAGIC))
        if magic != MAGIC:
            raise InvalidMagic(magic)
        crc = zlib.crc32(magic)
        while True:
            head = stream.read(HEAD.size)
            if len(head) < HEAD.size:
                raise EndOfFile
            opcode, length = HEAD.unpack(head)
            # a wrong length must not need the memory for it
            if length > size - stream.tell():
                raise EndOfFile
            content = stream.read(length)
            if opcode == Opcode.DATA_END:
                (stored,) = _CRC.unpack_from(content)
                if validate_crcs and stored not in (0, crc):
                    raise ValueError('the CRC over the data section is wrong')
            if opcode in (Opcode.DATA_END, Opcode.FOOTER):
                # what follows is the index, which may be damaged
                return
            if opcode == Opcode.CHUNK:
                chunk, start = _chunk(content)
                yield from chunk_records(chunk, validate_crc=validate_crcs)
            else:
                chunk, start = None, 0
                yield from _records(opcode, memoryview(content), len(content))
            if validate_crcs:
                crc = _continued(zlib.crc32(head, crc), content, chunk, start)


def _continued(crc: int, content: bytes, chunk: Chunk | None, start: int) -> int:
    """Return the CRC behind a record; ``start`` is that of the data of its valid chunk."""
    if chunk is None or chunk.compression or not chunk.uncompressed_crc:
        return zlib.crc32(content, crc)
    view = memoryview(content)
    crc = zlib.crc32(view[:start], crc)
    crc = combined_crc(crc, chunk.uncompressed_crc, len(chunk.data))
    return zlib.crc32(view[start + len(chunk.data) :], crc)


def _chunk(content: bytes) -> tuple[Chunk, int]:
    """Return a chunk, with a view of its data, and where they begin."""
    first, last, size, crc, name_length = CHUNK.unpack_from(content)
    name_end = CHUNK.size + name_length
    (length,) = _SIZE.unpack_from(content, name_end)
    start = name_end + _SIZE.size
    if length > len(content) - start:
        raise ValueError('a chunk is longer than its record')
    chunk = Chunk(
        compression=str(content[CHUNK.size : name_end], 'utf-8'),
        data=memoryview(content)[start : start + length],  # type: ignore[arg-type]
        message_start_time=first,
        message_end_time=last,
        uncompressed_crc=crc,
        uncompressed_size=size,
    )
    return chunk, start


def chunk_records(chunk: Chunk, *, validate_crc: bool) -> Iterator[Record]:
    """
    Yield the schemas, channels and messages of a chunk in the order in which they were written.

    :raises ValueError: the CRC is wrong, or a record does not fit into the chunk
    """
    if chunk.compression:
        stream, size = get_chunk_data_stream(chunk, validate_crc=validate_crc)
        data = memoryview(stream.read(size))
    else:
        data = memoryview(chunk.data)
        if validate_crc and chunk.uncompressed_crc not in (0, zlib.crc32(data)):
            raise ValueError('the CRC of a chunk is wrong')
    position = 0
    while position < len(data):
        if position + HEAD.size > len(data):
            raise ValueError('a chunk ends inside a record')
        opcode, length = HEAD.unpack_from(data, position)
        start = position + HEAD.size
        position = start + length
        if position > len(data):
            raise ValueError('a record is longer than its chunk')
        yield from _records(opcode, data[start:position], len(data))


def _records(opcode: int, content: memoryview, size: int) -> Iterator[Record]:
    """
    Yield a record if it is a schema, a channel or a message.

    size : of the chunk around it, bytes
    """
    if opcode == Opcode.MESSAGE:
        channel, _, log_time_ns, _ = _MESSAGE.unpack_from(content)
        message = content[_MESSAGE.size :]
        # a view keeps the whole chunk in memory as long as what is decoded from it
        yield channel, log_time_ns, message if 2 * len(message) > size else bytes(message)
    elif opcode == Opcode.CHANNEL:
        yield Channel.read(ReadDataStream(BytesIO(content)))
    elif opcode == Opcode.SCHEMA:
        yield Schema.read(ReadDataStream(BytesIO(content)))
