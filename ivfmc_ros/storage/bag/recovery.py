# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Reads the intact parts of a damaged MCAP file, also those behind the damage.

Where a record is damaged, the search continues at the next chunk whose header is consistent and
whose CRC is right. The file is mapped into memory; one chunk at a time is decompressed.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
import mmap
from pathlib import Path
import struct
from typing import Any
import zlib

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment
from mcap.records import Channel
from mcap.records import Chunk
from mcap.records import DataEnd
from mcap.records import Header
from mcap.records import McapRecord
from mcap.records import Message
from mcap.records import Metadata
from mcap.records import Schema
from mcap.stream_reader import breakup_chunk

from ivfmc_ros.errors import BagError
from ivfmc_ros.storage.bag.mcap_layout import CHUNK
from ivfmc_ros.storage.bag.mcap_layout import HEAD
from ivfmc_ros.storage.bag.mcap_layout import MAGIC
from ivfmc_ros.storage.bag.summary import is_cut_off
from ivfmc_ros.storage.bag.summary import READ_ERRORS
from ivfmc_ros.storage.bag.summary import read_summary

# Index of messages: channel, size of all its entries; size of an entry.
_INDEX, _INDEX_ENTRY = struct.Struct('<HI'), 16
_COMPRESSIONS = (b'', b'lz4', b'zstd')
# Opcodes from this one on are those of other programs (https://mcap.dev/spec).
_PRIVATE = 0x80
_TYPES: dict[int, Any] = {
    Opcode.HEADER: Header,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.MESSAGE: Message,
    Opcode.CHUNK: Chunk,
    Opcode.ATTACHMENT: Attachment,
    Opcode.METADATA: Metadata,
    Opcode.DATA_END: DataEnd,
}


@dataclass(frozen=True, kw_only=True)
class IntactPart:
    """
    Records that were read: those of one chunk, or one record outside of chunks.

    offset : of the first byte in the file
    is_chunk : the records are those of a chunk
    is_checked : they have a CRC, which is right
    """

    offset: int
    records: tuple[McapRecord, ...]
    is_chunk: bool = False
    is_checked: bool = False


@dataclass(frozen=True, kw_only=True)
class DamagedPart:
    """Bytes ``offset`` to ``end`` (excluded) of a file cannot be read; ``reason`` says why."""

    offset: int
    end: int
    reason: str

    def __str__(self) -> str:
        return f'bytes {self.offset} to {self.end}: {self.reason}'


def read_parts(file: Path) -> Iterator[IntactPart | DamagedPart]:
    """
    Yield the intact and the damaged parts of the data section of an MCAP file in their order.

    Ends at the end of the data section. A file that ends before yields a ``DamagedPart`` unless it
    ends at the end of a record, as a recording that was interrupted does.

    :raises BagError: the file cannot be read, or does not begin as MCAP
    """
    try:
        with file.open('rb') as stream:
            if stream.read(len(MAGIC)) != MAGIC:
                raise BagError(f'{file}: is not an MCAP file')
            with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
                yield from _parts(data)
    except OSError as error:
        raise BagError(f'{file}: cannot be read: {error.strerror or error}') from error


def known_channels(file: Path) -> tuple[dict[int, Channel], dict[int, Schema]]:
    """
    Return channels and schemas by id, of the index and of the intact parts of a file.

    :raises BagError: the file cannot be read
    """
    channels: dict[int, Channel] = {}
    schemas: dict[int, Schema] = {}
    for part in read_parts(file):
        if isinstance(part, IntactPart):
            for record in part.records:
                if isinstance(record, Channel):
                    channels[record.id] = record
                elif isinstance(record, Schema):
                    schemas[record.id] = record
    summary = None if is_cut_off(file) else read_summary(file)[0]
    if summary is not None:
        channels = {**summary.channels, **channels}
        schemas = {**summary.schemas, **schemas}
    return channels, schemas


def _parts(data: mmap.mmap) -> Iterator[IntactPart | DamagedPart]:
    position = len(MAGIC)
    crc = zlib.crc32(MAGIC)
    is_whole = True
    while position < len(data):
        if data[position] == Opcode.FOOTER:
            return
        part, end = part_at(data, position)
        if part is None:
            end, reason = skip_damage(data, position)
            yield DamagedPart(offset=position, end=end, reason=reason)
            is_whole = False
        else:
            [*_, last] = part.records or (None,)
            if isinstance(last, DataEnd) and not part.is_chunk:
                stored = last.data_section_crc
                if stored and is_whole and stored != crc:
                    yield DamagedPart(
                        offset=len(MAGIC), end=position,
                        reason='the CRC over the data section is wrong',
                    )  # fmt: skip
                return
            if part.records:
                yield part
            if is_whole:
                crc = zlib.crc32(data[position:end], crc)
        position = end


def part_at(data: mmap.mmap, position: int) -> tuple[IntactPart | None, int]:
    """Return the part at a position and its end; None where it is damaged."""
    end = _end(data, position)
    if end is None:
        return None, position
    opcode = data[position]
    kind = _TYPES.get(opcode)
    if kind is None:
        # indices, which are rebuilt, and records of other programs
        is_whole = opcode != Opcode.MESSAGE_INDEX or _is_message_index(data, position)
        return (IntactPart(offset=position, records=()) if is_whole else None), end
    content = data[position + HEAD.size : end]
    try:
        record = kind.read(*_arguments(kind, content))
        if isinstance(record, Chunk):
            if not _is_chunk(data, position):
                return None, end
            records = tuple(breakup_chunk(record, validate_crc=True))
            is_checked = bool(record.uncompressed_crc)
            part = IntactPart(
                offset=position, records=records, is_chunk=True, is_checked=is_checked
            )
        else:
            part = IntactPart(offset=position, records=(record,))
    except (*READ_ERRORS, EOFError, IndexError):
        return None, end
    return part, end


def _arguments(kind: Any, content: bytes) -> tuple[object, ...]:
    # a Message takes the rest of its record as data
    stream = ReadDataStream(BytesIO(content))
    return (stream, len(content)) if kind is Message else (stream,)


def _end(data: mmap.mmap, position: int) -> int | None:
    """Return where the record at a position ends; None where there can be no record."""
    if position + HEAD.size > len(data):
        return None
    opcode, length = HEAD.unpack_from(data, position)
    end = int(position + HEAD.size + length)
    is_known = Opcode.HEADER <= opcode <= Opcode.DATA_END or opcode >= _PRIVATE
    return end if is_known and end <= len(data) else None


def _is_chunk(data: mmap.mmap, position: int) -> bool:
    """Tell whether the lengths in the header of a chunk agree with each other and the file."""
    start = position + HEAD.size
    if start + CHUNK.size > len(data):
        return False
    _, length = HEAD.unpack_from(data, position)
    *_, name_length = CHUNK.unpack_from(data, start)
    name_end = start + CHUNK.size + name_length
    if name_length > 4 or name_end + 8 > len(data):
        return False
    (size,) = struct.unpack_from('<Q', data, name_end)
    is_known = data[start + CHUNK.size : name_end] in _COMPRESSIONS
    is_inside = position + HEAD.size + length <= len(data)
    return is_known and is_inside and bool(length == CHUNK.size + name_length + 8 + size)


def _is_message_index(data: mmap.mmap, position: int) -> bool:
    """Tell whether the lengths of an index agree: a wrong one would skip the chunks behind it."""
    _, length = HEAD.unpack_from(data, position)
    if length < _INDEX.size:
        return False
    _, size = _INDEX.unpack_from(data, position + HEAD.size)
    return bool(length == _INDEX.size + size and size % _INDEX_ENTRY == 0)


def skip_damage(data: mmap.mmap, position: int) -> tuple[int, str]:
    """Return where reading continues after a damaged record, and what is wrong with it."""
    end = _end(data, position)
    is_chunk = data[position] == Opcode.CHUNK
    if data[position] == Opcode.MESSAGE_INDEX:
        # no profile is lost with it, and its length is not known
        return _next_chunk(data, position + 1), 'an index is damaged'
    if end is None:
        following = _next_chunk(data, position + 1)
        if following == len(data):
            return following, 'the file is cut off'
        return following, 'no record begins here'
    # the record after it begins where its length says, unless that is damaged too
    if end == len(data) or _end(data, end) is not None:
        return end, 'the CRC of a chunk is wrong' if is_chunk else 'a record is damaged'
    return _next_chunk(data, position + 1), 'a record is damaged'


def _next_chunk(data: mmap.mmap, position: int) -> int:
    """Return the offset of the next consistent chunk, the size of the file where there is none."""
    while position < len(data):
        found = data.find(bytes([Opcode.CHUNK]), position)
        if found < 0:
            break
        # the upper half of a length is 0 in all but absurd files
        if data[found + 5 : found + 9] == b'\0\0\0\0' and _is_chunk(data, found):
            return found
        position = found + 1
    return len(data)
