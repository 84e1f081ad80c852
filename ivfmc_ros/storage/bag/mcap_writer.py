# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Writes the records of an MCAP file chunk by chunk (https://mcap.dev/spec).

The Writer of the mcap library has a fixed zstd level, which takes four times as long for a camera
image as level 1 and compresses it less, and does not return the offset of a chunk, which the
catalogue stores. The record types are those of the library.
"""

from collections import Counter
from collections.abc import Mapping
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

from ivfmc_ros.storage.bag.mcap_layout import MAGIC
from ivfmc_ros.storage.bag.unfinished_mcap import LIBRARY
from ivfmc_ros.storage.bag.unfinished_mcap import WrittenPart

# zstd level: a 1.3 MB camera image takes 3 ms; higher levels gain nothing on image noise.
_ZSTD_LEVEL = 1


class McapWriter:
    """
    Writes messages to a binary stream; a message is in the file after ``flush``.

    A file that ends before ``finish`` can be read up to its last chunk.
    """

    def __init__(
        self,
        stream: IO[bytes],
        *,
        compress: bool = True,
        library: str = LIBRARY,
        written: WrittenPart | None = None,
    ) -> None:
        """
        Write the header, or go on behind what a former writer wrote.

        stream : seekable; stays open after ``finish``
        compress : compress chunks by zstd
        library : name of the recorder; that of this package: the sequence of a message is its
            index in its topic
        written : what ``stream`` holds, at whose end it stands and is cut off; None: nothing
        """
        self._stream = stream
        self._compressor = zstandard.ZstdCompressor(level=_ZSTD_LEVEL) if compress else None
        self._crc = 0
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._chunk_indices: list[ChunkIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._counts: Counter[int] = Counter()
        self._chunk = RecordBuilder()
        self._indices: dict[int, MessageIndex] = {}
        self._times: list[int] = []
        self._span: tuple[int, int] = (0, 0)
        if written is None:
            self._write(MAGIC)
            self._write_record(Header(profile='ros2', library=library))
        else:
            self._go_on(written)

    def _go_on(self, written: WrittenPart) -> None:
        self._crc, self._span = written.crc, written.span_ns
        self._schemas, self._channels = list(written.schemas), list(written.channels)
        self._chunk_indices, self._counts = list(written.chunk_indices), Counter(written.counts)
        if written.torn:
            last, offset = self._chunk_indices[-1], written.end
            last.message_index_offsets, end = self._write_indices(written.torn, offset)
            last.message_index_length = end - offset

    def add_schema(self, name: str, data: bytes, encoding: str = 'ros2msg') -> int:
        """Add a message definition, ``data`` in the format of ``encoding``, and return its id."""
        number = 1 + max((schema.id for schema in self._schemas), default=0)
        self._schemas.append(Schema(id=number, name=name, encoding=encoding, data=data))
        self._schemas[-1].write(self._chunk)
        return number

    def add_channel(self, topic: str, encoding: str, schema: int, metadata: dict[str, str]) -> int:
        """Add a channel of messages of a schema (its id) and return the channel's id."""
        number = 1 + max((channel.id for channel in self._channels), default=0)
        self._channels.append(
            Channel(
                id=number,
                topic=topic,
                message_encoding=encoding,
                metadata=metadata,
                schema_id=schema,
            )
        )
        self._channels[-1].write(self._chunk)
        return number

    def add_message(
        self,
        channel: int,
        time_ns: int,
        data: bytes,
        sequence: int,
        publish_ns: int | None = None,
    ) -> None:
        """
        Add a message to the present chunk.

        time_ns, publish_ns : log time and publish time, nanoseconds; None: equal to the log time
        """
        index = self._indices.setdefault(channel, MessageIndex(channel_id=channel, records=[]))
        index.records.append((time_ns, self._chunk.count))
        self._times.append(time_ns)
        Message(
            channel_id=channel,
            log_time=time_ns,
            data=data,
            publish_time=time_ns if publish_ns is None else publish_ns,
            sequence=sequence,
        ).write(self._chunk)
        self._counts[channel] += 1

    def flush(self) -> int:
        """Write the present chunk, unless it is empty; return its offset in the file, bytes."""
        offset = self._stream.tell()
        if self._times:
            self._write_chunk(offset)
        self._stream.flush()
        return offset

    def add_metadata(self, name: str, values: dict[str, str]) -> None:
        """Write the present chunk and a metadata record."""
        self.flush()
        offset = self._stream.tell()
        length = self._write_record(Metadata(name=name, metadata=values))
        self._metadata.append(MetadataIndex(offset=offset, length=length, name=name))

    def finish(self) -> None:
        """Write the present chunk, the summary section (index) and the footer."""
        self.flush()
        self._write_record(DataEnd(self._crc))
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
        data = _take_bytes(summary)
        footer = RecordBuilder()
        Footer(summary_start=start, summary_offset_start=offsets_start, summary_crc=0).write(
            footer
        )
        # the CRC covers the summary section and the footer up to the CRC itself
        head = _take_bytes(footer)[:-4]
        crc = zlib.crc32(head, zlib.crc32(data))
        self._stream.write(data + head + crc.to_bytes(4, 'little') + MAGIC)
        self._stream.flush()

    def _summary(self) -> Sequence[tuple[Opcode, Sequence[Any]]]:
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=dict(self._counts),
            chunk_count=len(self._chunk_indices),
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
            (Opcode.CHUNK_INDEX, self._chunk_indices),
            (Opcode.METADATA_INDEX, self._metadata),
        )

    def _write_chunk(self, offset: int) -> None:
        plain = _take_bytes(self._chunk)
        compressed = plain if self._compressor is None else self._compressor.compress(plain)
        first, last = min(self._times), max(self._times)
        start, end = self._span if self._chunk_indices else (first, last)
        self._span = min(start, first), max(end, last)
        compression = '' if self._compressor is None else 'zstd'
        length = self._write_record(
            Chunk(
                compression=compression,
                data=compressed,
                message_start_time=first,
                message_end_time=last,
                uncompressed_crc=zlib.crc32(plain),
                uncompressed_size=len(plain),
            )
        )
        index_offsets, index_end = self._write_indices(self._indices, offset + length)
        self._chunk_indices.append(
            ChunkIndex(
                chunk_length=length,
                chunk_start_offset=offset,
                compression=compression,
                compressed_size=len(compressed),
                message_start_time=first,
                message_end_time=last,
                message_index_length=index_end - offset - length,
                message_index_offsets=index_offsets,
                uncompressed_size=len(plain),
            )
        )
        self._indices, self._times = {}, []

    def _write_indices(
        self, indices: Mapping[int, MessageIndex], offset: int
    ) -> tuple[dict[int, int], int]:
        """Write the message indices of a chunk; return their offsets by channel, and the end."""
        offsets = {}
        for channel, index in indices.items():
            offsets[channel] = offset
            offset += self._write_record(index)
        return offsets, offset

    def _write_record(self, record: Any) -> int:
        builder = RecordBuilder()
        record.write(builder)
        data = _take_bytes(builder)
        self._write(data)
        return len(data)

    def _write(self, data: bytes) -> None:
        self._crc = zlib.crc32(data, self._crc)
        self._stream.write(data)


def _take_bytes(builder: Any) -> bytes:
    """Return the content of a builder and empty it."""
    return bytes(builder.end())
