# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Reads what an MCAP file of an interrupted recording holds, so that a writer can go on behind it.

The part that stays are the whole chunks with their message indices. A file that was finished is
read up to its index, which the writer makes anew. A file that is damaged before its last chunk is
refused: it has to be repaired first.
"""

from collections import Counter
from collections.abc import Callable
from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import field
import mmap
from pathlib import Path
import struct
from typing import Any
import zlib

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel
from mcap.records import ChunkIndex
from mcap.records import Header
from mcap.records import McapRecord
from mcap.records import Message
from mcap.records import MessageIndex
from mcap.records import Schema

from ivfmc_ros.errors import BagError
from ivfmc_ros.storage.bag.mcap_layout import CHUNK
from ivfmc_ros.storage.bag.mcap_layout import HEAD
from ivfmc_ros.storage.bag.mcap_layout import MAGIC
from ivfmc_ros.storage.bag.recovery import IntactPart
from ivfmc_ros.storage.bag.recovery import part_at
from ivfmc_ros.storage.bag.recovery import skip_damage

# Name of this package in the header of its files: the sequence of a message is its index there.
LIBRARY = 'ivfmc_ros'

# Channel of a message index, behind the head of the record.
_CHANNEL = struct.Struct('<H')


@dataclass(kw_only=True)
class WrittenPart:
    """
    The part of a file that stays when a writer goes on.

    end : offset at which it ends, bytes
    crc : of its bytes
    schemas, channels : in the order in which they were written
    chunk_indices : of its chunks
    counts : number of messages by the id of their channel
    following : sequence of the next message of a channel, by its id
    message_bytes : size of all messages
    torn : message indices of the last chunk, if the recorder was interrupted before it wrote them
    """

    end: int = len(MAGIC)
    crc: int = 0
    schemas: list[Schema] = field(default_factory=list)
    channels: list[Channel] = field(default_factory=list)
    chunk_indices: list[ChunkIndex] = field(default_factory=list)
    counts: Counter[int] = field(default_factory=Counter)
    following: dict[int, int] = field(default_factory=dict)
    message_bytes: int = 0
    torn: dict[int, MessageIndex] = field(default_factory=dict)

    @property
    def span_ns(self) -> tuple[int, int]:
        """Smallest and greatest log time, nanoseconds; zeros without messages."""
        if not self.chunk_indices:
            return 0, 0
        return (
            min(index.message_start_time for index in self.chunk_indices),
            max(index.message_end_time for index in self.chunk_indices),
        )


# Called with what was read before a message, the offset of its chunk in the file, and the message.
Visit = Callable[[WrittenPart, int, Message], None]


def ignore_message(written: WrittenPart, offset: int, message: Message) -> None:
    """Visit a message without use for it."""


def read_written_part(file: Path, visit: Visit = ignore_message) -> WrittenPart:
    """
    Return what of a file stays; every chunk is decompressed and its CRC is checked.

    visit : called with every message
    :raises BagError: the file cannot be read, is not of this package, or is damaged before its
        last whole chunk
    """
    try:
        with file.open('rb') as stream:
            if stream.read(len(MAGIC)) != MAGIC:
                raise BagError(f'{file}: is not an MCAP file')
            with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
                return _read(data, file, visit)
    except OSError as error:
        raise BagError(f'{file}: cannot be read: {error.strerror or error}') from error


def _read(data: mmap.mmap, file: Path, visit: Visit) -> WrittenPart:
    written = WrittenPart()
    position, damaged = len(MAGIC), -1
    while position < len(data) and data[position] not in (Opcode.METADATA, Opcode.DATA_END):
        part, end = part_at(data, position)
        if part is None:
            end, _ = skip_damage(data, position)
            damaged = position if damaged < 0 else damaged
        elif damaged >= 0:
            _require_no_chunk(part, file, damaged)
        elif part.is_chunk:
            _add_chunk(written, data, position, end, part.records)
            for record in part.records:
                if isinstance(record, Message):
                    visit(written, position, record)
        elif data[position] == Opcode.MESSAGE_INDEX:
            _add_index(written, data, position, end)
        else:
            _require_ours(part, file)
            written.end = end
        position = end
    if written.torn:
        # all of them are written anew
        written.chunk_indices[-1].message_index_offsets.clear()
        written.chunk_indices[-1].message_index_length = 0
    with memoryview(data) as view:
        written.crc = zlib.crc32(view[: written.end])
    return written


def _require_no_chunk(part: IntactPart, file: Path, damaged: int) -> None:
    if part.is_chunk:
        raise BagError(
            f'{file}: is damaged at byte {damaged}, before its last chunk; ivfmc scans repair '
            'keeps what is intact, ivfmc reconstruct makes a mesh of it'
        )


def _require_ours(part: IntactPart, file: Path) -> None:
    """Refuse a file of another program, which may have records outside of chunks."""
    for record in part.records:
        if not isinstance(record, Header):
            raise BagError(f'{file}: has records outside of chunks: another program wrote it')
        if record.library != LIBRARY:
            raise BagError(f'{file}: was written by {record.library!r}, not by {LIBRARY}')


def _add_chunk(
    written: WrittenPart,
    data: mmap.mmap,
    position: int,
    end: int,
    records: Sequence[McapRecord],
) -> None:
    """Add a chunk; its message indices have to follow it."""
    first_ns, last_ns, size, _, name_length = CHUNK.unpack_from(data, position + HEAD.size)
    name_at = position + HEAD.size + CHUNK.size
    written.chunk_indices.append(
        ChunkIndex(
            chunk_length=end - position,
            chunk_start_offset=position,
            compression=data[name_at : name_at + name_length].decode('ascii'),
            compressed_size=end - name_at - name_length - 8,
            message_start_time=first_ns,
            message_end_time=last_ns,
            message_index_length=0,
            message_index_offsets={},
            uncompressed_size=size,
        )
    )
    for record in records:
        if isinstance(record, Schema):
            written.schemas.append(record)
        elif isinstance(record, Channel):
            written.channels.append(record)
        elif isinstance(record, Message):
            number = record.channel_id
            written.counts[number] += 1
            written.message_bytes += len(record.data)
            following = max(written.following.get(number, 0), record.sequence + 1)
            written.following[number] = following
    written.torn, written.end = _message_indices(records), end


def _message_indices(records: Sequence[McapRecord]) -> dict[int, MessageIndex]:
    """Return the message indices of the records of a chunk, by channel."""
    builder: Any = RecordBuilder()
    found: dict[int, MessageIndex] = {}
    count = 0
    for record in records:
        if isinstance(record, Message):
            index = found.setdefault(
                record.channel_id, MessageIndex(channel_id=record.channel_id, records=[])
            )
            index.records.append((record.log_time, count))
            # head; channel, sequence, log time and publish time; data
            count += HEAD.size + 22 + len(record.data)
        else:
            record.write(builder)
            count += len(builder.end())
    return found


def _add_index(written: WrittenPart, data: mmap.mmap, position: int, end: int) -> None:
    """Note a message index that is in the file; the last one of a chunk ends it."""
    if not written.torn:
        return
    (channel,) = _CHANNEL.unpack_from(data, position + HEAD.size)
    chunk = written.chunk_indices[-1]
    chunk.message_index_offsets[channel] = position
    chunk.message_index_length += end - position
    if written.torn.keys() <= chunk.message_index_offsets.keys():
        written.torn, written.end = {}, end
