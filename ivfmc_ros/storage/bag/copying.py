# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Copies the intact messages of MCAP files to new files with an index, topics by choice."""

from collections.abc import Callable
from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import dataclass
import os
from pathlib import Path

from mcap.records import Channel
from mcap.records import Header
from mcap.records import Message
from mcap.records import Metadata
from mcap.records import Schema

from ivfmc_ros.storage.bag import metadata
from ivfmc_ros.storage.bag.decompression import plain_message
from ivfmc_ros.storage.bag.mcap_writer import McapWriter
from ivfmc_ros.storage.bag.recovery import IntactPart
from ivfmc_ros.storage.bag.recovery import known_channels
from ivfmc_ros.storage.bag.recovery import read_parts
from ivfmc_ros.storage.messages import cdr

# Tells by name and type whether a topic is copied.
TopicFilter = Callable[[str, str], bool]

# Uncompressed bytes after which messages that were outside of chunks are written as one.
_CHUNK_BYTES = 8 * 1024 * 1024


@dataclass(frozen=True, kw_only=True)
class CopiedFile:
    """A file of a bag and its topics by name, for metadata.yaml."""

    file: metadata.FileMetadata
    topics: Mapping[str, metadata.TopicMetadata]


def copy_file(
    source: Path,
    target: Path,
    name: str,
    is_wanted: TopicFilter = lambda topic, msgtype: True,
) -> CopiedFile:
    """
    Copy the intact messages of a file, chunk by chunk; the compression becomes zstd of chunks.

    target : is overwritten
    name : of the file in metadata.yaml
    :raises BagError: the source cannot be read, or a message cannot be decompressed
    """
    channels, schemas = known_channels(source)
    with target.open('wb') as stream:
        writer = McapWriter(stream, library=_library(source))
        copier = _Copier(writer, channels, schemas, is_wanted)
        for part in read_parts(source):
            if isinstance(part, IntactPart):
                copier.add(part)
        copy = copier.described(name)
        info = metadata.bag_information([copy.file], list(copy.topics.values()))
        # rosbag2 reads a file without its folder by this record
        writer.add_metadata('rosbag2', {'serialized_metadata': metadata.dump(info)})
        writer.finish()
        stream.flush()
        os.fsync(stream.fileno())
    return copy


def describe_file(source: Path) -> CopiedFile:
    """
    Return the description of a file, which is not copied.

    :raises BagError: it cannot be read
    """
    copier = _Copier(None, *known_channels(source))
    for part in read_parts(source):
        if isinstance(part, IntactPart):
            copier.add(part)
    return copier.described(source.name)


def merged_topics(copies: Sequence[CopiedFile]) -> list[metadata.TopicMetadata]:
    """Return the topics of all files of a bag, with their counts added."""
    topics: dict[str, metadata.TopicMetadata] = {}
    for copy in copies:
        for name, topic in copy.topics.items():
            known = topics.get(name)
            count = topic.count + (known.count if known else 0)
            topics[name] = metadata.TopicMetadata(**{**vars(topic), 'count': count})
    return list(topics.values())


def _library(source: Path) -> str:
    for part in read_parts(source):
        for record in part.records if isinstance(part, IntactPart) else ():
            if isinstance(record, Header):
                return str(record.library)
        break
    return 'unknown'


def _type(schema: Schema | None) -> str:
    return cdr.full_name(schema.name) if schema else ''


class _Copier:
    """Copies messages to a writer, chunk by chunk, and counts them; without a writer, counts."""

    def __init__(
        self,
        writer: McapWriter | None,
        channels: Mapping[int, Channel],
        schemas: Mapping[int, Schema],
        is_wanted: TopicFilter = lambda topic, msgtype: True,
    ) -> None:
        self._writer = writer
        self._channels = {
            number: channel
            for number, channel in channels.items()
            if is_wanted(channel.topic, _type(schemas.get(channel.schema_id)))
        }
        self._schemas = schemas
        self._new_schemas: dict[int, int] = {}
        self._new_channels: dict[int, int] = {}
        self._counts: dict[int, int] = {}
        self._span: tuple[int, int] | None = None
        self._pending = 0

    @property
    def writer(self) -> McapWriter:
        if self._writer is None:
            raise ValueError('only counts')
        return self._writer

    def add(self, part: IntactPart) -> None:
        for record in part.records:
            if isinstance(record, Message) and record.channel_id in self._channels:
                self._add_message(record)
            elif isinstance(record, Metadata) and self._writer and record.name != 'rosbag2':
                self._writer.add_metadata(record.name, record.metadata)
        if self._writer and (part.is_chunk or self._pending >= _CHUNK_BYTES):
            self._writer.flush()
            self._pending = 0

    def _add_message(self, message: Message) -> None:
        number = message.channel_id
        self._counts[number] = self._counts.get(number, 0) + 1
        start, end = self._span or (message.log_time, message.log_time)
        self._span = min(start, message.log_time), max(end, message.log_time)
        if self._writer is None:
            return
        channel = self._channels[number]
        if number not in self._new_channels:
            self._new_channels[number] = self._add_channel(self.writer, channel)
        # metadata.yaml of the copy names no compression of messages
        data = bytes(plain_message(message.data, channel.topic, self._counts[number] - 1))
        self._pending += len(data)
        self.writer.add_message(
            self._new_channels[number],
            message.log_time,
            data,
            message.sequence,
            message.publish_time,
        )

    def _add_channel(self, writer: McapWriter, channel: Channel) -> int:
        schema = self._schemas.get(channel.schema_id)
        new = 0
        if schema is not None:
            new = self._new_schemas.get(schema.id, 0) or writer.add_schema(
                schema.name, schema.data, schema.encoding
            )
            self._new_schemas[schema.id] = new
        return writer.add_channel(
            channel.topic, channel.message_encoding, new, dict(channel.metadata)
        )

    def described(self, name: str) -> CopiedFile:
        topics: dict[str, metadata.TopicMetadata] = {}
        for number, count in self._counts.items():
            channel = self._channels[number]
            schema = self._schemas.get(channel.schema_id)
            known = topics.get(channel.topic)
            topics[channel.topic] = metadata.TopicMetadata(
                topic=channel.topic,
                msgtype=_type(schema),
                count=count + (known.count if known else 0),
                type_hash=channel.metadata.get('topic_type_hash', ''),
                qos=channel.metadata.get('offered_qos_profiles', ''),
            )
        start, end = self._span or (0, 0)
        count = sum(self._counts.values())
        file = metadata.FileMetadata(name=name, start_ns=start, end_ns=end, count=count)
        return CopiedFile(file=file, topics=topics)
