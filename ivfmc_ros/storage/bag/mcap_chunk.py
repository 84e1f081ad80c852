# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Iterates the records of a chunk of an MCAP file, with its CRC checked once.

The mcap library copies every message out of its chunk. A picture of a scan fills its chunk alone,
and is yielded as a view of it.
"""

from collections.abc import Iterator
from io import BytesIO
import struct

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel
from mcap.records import Chunk
from mcap.records import Schema
from mcap.stream_reader import get_chunk_data_stream

from ivfmc_ros.storage.bag.bag_file import Encoded

# Opcode and content length of a record.
_HEAD = struct.Struct('<BQ')
# Message before its data: channel, sequence, log time and publish time.
_MESSAGE = struct.Struct('<HIQQ')

# Channel id, log time in nanoseconds, and data.
ChunkMessage = tuple[int, int, Encoded]


def chunk_records(
    chunk: Chunk, *, validate_crc: bool
) -> Iterator[Schema | Channel | ChunkMessage]:
    """
    Yield the schemas, channels and messages of a chunk in the order in which they were written.

    :raises ValueError: the CRC is wrong, or a record does not fit into the chunk
    """
    stream, size = get_chunk_data_stream(chunk, validate_crc=validate_crc)
    data = stream.read(size)
    view = memoryview(data)
    position = 0
    while position < size:
        if position + _HEAD.size > size:
            raise ValueError('a chunk ends inside a record')
        opcode, length = _HEAD.unpack_from(data, position)
        start = position + _HEAD.size
        position = start + length
        if position > size:
            raise ValueError('a record is longer than its chunk')
        content = view[start:position]
        if opcode == Opcode.MESSAGE:
            channel, _, log_time_ns, _ = _MESSAGE.unpack_from(content)
            message = content[_MESSAGE.size :]
            # a view keeps the whole chunk in memory as long as what is decoded from it
            yield channel, log_time_ns, message if 2 * len(message) > size else bytes(message)
        elif opcode == Opcode.CHANNEL:
            yield Channel.read(ReadDataStream(BytesIO(content)))
        elif opcode == Opcode.SCHEMA:
            yield Schema.read(ReadDataStream(BytesIO(content)))
