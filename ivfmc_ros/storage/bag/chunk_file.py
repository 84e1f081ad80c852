# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
An MCAP file that grows chunk by chunk.

The writer of the mcap library compresses at one level, which takes four times as long for a
picture as the fastest one and leaves more; and it does not tell where a chunk begins. The
records themselves are the library's.
"""

from collections import Counter
from collections.abc import Sequence
from typing import Any
from typing import IO
import zlib

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel
from mcap.records import Chunk
from mcap.records import ChunkIndex
from mcap.records import DataEnd
from mcap.records import Footer
from mcap.records import Header
from mcap.records import Message
from mcap.records import MessageIndex
from mcap.records import Metadata
from mcap.records import MetadataIndex
from mcap.records import Schema
from mcap.records import Statistics
from mcap.records import SummaryOffset
import zstandard

_MAGIC = b'\x89MCAP0\r\n'
_LEVEL = 1


class ChunkFile:
    """Messages come in by ``add`` and are in the file after ``flush``."""

    def __init__(self, stream: IO[bytes], *, compress: bool = True) -> None:
        """Begin the file."""
        self._stream = stream
        self._compressor = zstandard.ZstdCompressor(level=_LEVEL) if compress else None
        self._crc = 0
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._chunks: list[ChunkIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._counts: Counter[int] = Counter()
        self._open = RecordBuilder()
        self._indices: dict[int, MessageIndex] = {}
        self._times: list[int] = []
        self._span: tuple[int, int] = (0, 0)
        self._write(_MAGIC)
        self._write_records(Header(profile='ros2', library='ivfmc_ros'))

    def schema(self, name: str, text: str) -> int:
        """Register a ros2msg definition and return its number."""
        number = len(self._schemas) + 1
        self._schemas.append(Schema(id=number, name=name, encoding='ros2msg', data=text.encode()))
        self._schemas[-1].write(self._open)
        return number

    def channel(self, topic: str, encoding: str, schema: int, metadata: dict[str, str]) -> int:
        """Register a topic and return its number."""
        number = len(self._channels) + 1
        self._channels.append(
            Channel(
                id=number,
                topic=topic,
                message_encoding=encoding,
                metadata=metadata,
                schema_id=schema,
            )
        )
        self._channels[-1].write(self._open)
        return number

    def add(self, channel: int, time_ns: int, data: bytes, sequence: int) -> None:
        """Put a message into the chunk in the making."""
        index = self._indices.setdefault(channel, MessageIndex(channel_id=channel, records=[]))
        index.records.append((time_ns, self._open.count))
        self._times.append(time_ns)
        Message(
            channel_id=channel,
            log_time=time_ns,
            data=data,
            publish_time=time_ns,
            sequence=sequence,
        ).write(self._open)
        self._counts[channel] += 1

    def flush(self) -> int:
        """Write the chunk in the making, if it has messages, and return its place in bytes."""
        offset = self._stream.tell()
        if self._times:
            self._write_chunk(offset)
        self._stream.flush()
        return offset

    def metadata(self, name: str, values: dict[str, str]) -> None:
        """Write a metadata record."""
        self.flush()
        offset = self._stream.tell()
        length = self._write_records(Metadata(name=name, metadata=values))
        self._metadata.append(MetadataIndex(offset=offset, length=length, name=name))

    def finish(self) -> None:
        """Write the index; the stream stays open."""
        self.flush()
        self._write_records(DataEnd(self._crc))
        start = self._stream.tell()
        summary = RecordBuilder()
        offsets = []
        for opcode, records in self._summary():
            begin = summary.count
            for record in records:
                record.write(summary)
            if summary.count > begin:
                offsets.append(SummaryOffset(opcode, summary.count - begin, start + begin))
        offsets_start = start + summary.count
        for offset in offsets:
            offset.write(summary)
        data = _bytes(summary)
        footer = RecordBuilder()
        Footer(summary_start=start, summary_offset_start=offsets_start, summary_crc=0).write(
            footer
        )
        # the checksum covers the summary and the footer up to the checksum itself
        head = _bytes(footer)[:-4]
        crc = zlib.crc32(head, zlib.crc32(data))
        self._stream.write(data + head + crc.to_bytes(4, 'little') + _MAGIC)
        self._stream.flush()

    def _summary(self) -> Sequence[tuple[Opcode, Sequence[Any]]]:
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=dict(self._counts),
            chunk_count=len(self._chunks),
            message_count=self._counts.total(),
            message_start_time=self._span[0],
            message_end_time=self._span[1],
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )
        return (
            (Opcode.SCHEMA, self._schemas),
            (Opcode.CHANNEL, self._channels),
            (Opcode.STATISTICS, [statistics]),
            (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.METADATA_INDEX, self._metadata),
        )

    def _write_chunk(self, offset: int) -> None:
        plain = _bytes(self._open)
        packed = plain if self._compressor is None else self._compressor.compress(plain)
        first, last = min(self._times), max(self._times)
        start, end = self._span if self._chunks else (first, last)
        self._span = min(start, first), max(end, last)
        kind = '' if self._compressor is None else 'zstd'
        length = self._write_records(
            Chunk(
                compression=kind,
                data=packed,
                message_start_time=first,
                message_end_time=last,
                uncompressed_crc=zlib.crc32(plain),
                uncompressed_size=len(plain),
            )
        )
        places, place = {}, offset + length
        for channel, index in self._indices.items():
            places[channel] = place
            place += self._write_records(index)
        self._chunks.append(
            ChunkIndex(
                chunk_length=length,
                chunk_start_offset=offset,
                compression=kind,
                compressed_size=len(packed),
                message_start_time=first,
                message_end_time=last,
                message_index_length=place - offset - length,
                message_index_offsets=places,
                uncompressed_size=len(plain),
            )
        )
        self._indices, self._times = {}, []

    def _write_records(self, record: Any) -> int:
        builder = RecordBuilder()
        record.write(builder)
        data = _bytes(builder)
        self._write(data)
        return len(data)

    def _write(self, data: bytes) -> None:
        self._crc = zlib.crc32(data, self._crc)
        self._stream.write(data)


def _bytes(builder: Any) -> bytes:
    """Return what a builder holds, and empty it."""
    return bytes(builder.end())
