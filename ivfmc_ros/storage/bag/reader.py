# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reads MCAP bags of any recorder; detects damage and salvages what is intact."""

from collections import Counter
from collections.abc import Callable
from collections.abc import Collection
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.records import Channel
from mcap.records import DataEnd
from mcap.records import Message
from mcap.records import Schema
from mcap.stream_reader import StreamReader

from ivfmc_ros.errors import BagError
from ivfmc_ros.file_kinds import kind_of_file
from ivfmc_ros.storage.bag.locate import find_files
from ivfmc_ros.storage.bag.locate import is_unfinished
from ivfmc_ros.storage.bag.recovery import IntactPart
from ivfmc_ros.storage.bag.recovery import known_channels
from ivfmc_ros.storage.bag.recovery import read_parts
from ivfmc_ros.storage.bag.summary import is_cut_off
from ivfmc_ros.storage.bag.summary import READ_ERRORS
from ivfmc_ros.storage.bag.summary import read_summary
from ivfmc_ros.storage.messages import cdr

_MAGIC = b'\x89MCAP0\r\n'
_SALVAGE_ADVICE = ', or use what can be read (--salvage)'


@dataclass(frozen=True, kw_only=True)
class Topic:
    """
    A topic of a bag.

    msgtype : such as 'sensor_msgs/msg/Image'; '' where the bag has no schema of it
    encoding : of the messages, such as 'cdr'
    count : number of messages
    schema_encoding, definition : 'ros2msg' or 'ros2idl', and the message definition in it
    """

    name: str
    msgtype: str
    encoding: str
    count: int
    schema_encoding: str = ''
    definition: str = ''


@dataclass(frozen=True, kw_only=True)
class RawMessage:
    """An encoded message; ``index`` is its index in its topic, from 0."""

    topic: str
    index: int
    log_time_ns: int
    data: bytes


@dataclass(frozen=True, kw_only=True)
class Bag:
    """
    A bag: one MCAP file, or the files of a split recording in order.

    path : as the user named it, for error messages
    topics : by name
    damage : description of the damage of a bag that was opened for salvage, or None
    remarks : what was missing or damaged and did not prevent reading, damage included
    """

    path: Path
    files: tuple[Path, ...]
    topics: dict[str, Topic]
    damage: str | None = None
    remarks: tuple[str, ...] = ()

    @property
    def message_count(self) -> int:
        """Number of messages on all topics."""
        return sum(topic.count for topic in self.topics.values())

    def topic(self, name: str) -> Topic:
        """
        Return a topic by name.

        :raises BagError: there is no such topic; the message lists the existing ones
        """
        if name not in self.topics:
            raise BagError(f'{self.path}: has no topic {name}; it has {self.listing()}')
        return self.topics[name]

    def listing(self) -> str:
        """Return the topics with their types, for error messages."""
        topics = sorted(self.topics.values(), key=lambda topic: topic.name)
        return ', '.join(f'{topic.name} ({topic.msgtype})' for topic in topics) or 'no topics'

    def decoder(self, name: str) -> Callable[[RawMessage], Any]:
        """
        Return a function that decodes the messages of a topic by the definition in the bag.

        :raises BagError: the topic is missing, is not CDR, or has no usable definition
        """
        topic = self.topic(name)
        where = f'{self.path}: {name}'
        if topic.encoding != cdr.ENCODING:
            raise BagError(f'{where}: is encoded as {topic.encoding!r}, only cdr can be read')
        definition, schema_encoding = topic.definition, topic.schema_encoding
        if not definition and topic.msgtype and cdr.knows(cdr.full_name(topic.msgtype)):
            # some recorders leave the definitions of known types out
            definition = cdr.definition(cdr.full_name(topic.msgtype))
            schema_encoding = 'ros2msg'
        if not definition:
            raise BagError(f'{where}: the bag has no message definition (schema) of the topic')
        try:
            decode = cdr.decoder(topic.msgtype, schema_encoding, definition)
        except BagError as error:
            raise BagError(f'{where}: {error}') from error

        def decode_named(raw: RawMessage) -> Any:
            try:
                return decode(raw.data)
            except BagError as error:
                raise BagError(f'{where}, message {raw.index}: {error}') from error

        return decode_named

    def stamp_ns(self, raw: RawMessage) -> int:
        """
        Return the stamp, nanoseconds, of a message that begins with a header, without decoding it.

        :raises BagError: the message is too short for a header
        """
        try:
            return cdr.leading_stamp_ns(raw.data)
        except BagError as error:
            raise BagError(f'{self.path}: {raw.topic}, message {raw.index}: {error}') from error

    def messages(self, topics: Collection[str]) -> Iterator[RawMessage]:
        """
        Yield the messages of some topics in the order in which they were written.

        :raises BagError: the bag is damaged and was not opened for salvage, or its messages do
            not agree with its index
        """
        seen: Counter[str] = Counter()
        for file in self.files:
            try:
                source = _stream(file) if self.damage is None else _intact(file)
                for channel, message in source:
                    if channel.topic not in self.topics:
                        raise BagError(
                            f'{file}: is damaged: topic {channel.topic} is in the messages, not '
                            f'in the index; copy the file again{_SALVAGE_ADVICE}'
                        )
                    if channel.topic in topics:
                        index = seen[channel.topic]
                        seen[channel.topic] += 1
                        yield _raw(channel.topic, index, message)
            except _DamageError as error:
                raise BagError(_refusal(_damage_text(error, file))) from error
        if self.damage is None:
            self._require_counts(seen, topics)

    def _require_counts(self, seen: Counter[str], topics: Collection[str]) -> None:
        for name in topics:
            counted = self.topics[name].count if name in self.topics else 0
            if seen[name] != counted:
                raise BagError(
                    f'{self.path}: is damaged: topic {name} has {seen[name]} messages, its index '
                    f'lists {counted}; copy the file again{_SALVAGE_ADVICE}'
                )


class _DamageError(Exception):
    """A file is cut off, or a record of it is corrupt."""


def open_bag(path: Path, *, salvage: bool = False) -> Bag:
    """
    Open a bag folder or an ``.mcap`` file.

    A recording that was not finished (``scan.mcap.part``), or whose ``metadata.yaml`` is missing,
    is read as far as it goes; ``Bag.remarks`` says so.

    salvage : accept any damaged bag; ``Bag.damage`` describes the damage
    :raises BagError: the path is not a bag, the bag is damaged, or its encoding is not supported
    """
    files, missing = find_files(path)
    topics: dict[str, Topic] = {}
    damage = None
    remarks = [missing] if missing else []
    for file in files:
        # a recording that was not finished is cut off at its last chunk
        accept = salvage or is_unfinished(file)
        found, file_damage, remark = _topics(file, use_index=not accept)
        if file_damage and not accept:
            raise BagError(_refusal(file_damage))
        damage = damage or file_damage
        if file_damage or remark:
            remarks.append(file_damage or remark)
        for topic in found:
            _add(topics, topic)
    _require_cdr(path, topics)
    return Bag(path=path, files=files, topics=topics, damage=damage, remarks=tuple(remarks))


def _add(topics: dict[str, Topic], topic: Topic) -> None:
    # a topic has several channels in a split recording, or with several publishers
    known = topics.get(topic.name)
    if known is None:
        topics[topic.name] = topic
        return
    fields = {**vars(topic), 'count': known.count + topic.count}
    topics[topic.name] = Topic(**fields)


def _require_cdr(path: Path, topics: dict[str, Topic]) -> None:
    encodings = {topic.encoding for topic in topics.values()}
    if encodings and cdr.ENCODING not in encodings:
        names = ', '.join(sorted(topics))
        raise BagError(
            f'{path}: the messages are encoded as {", ".join(map(repr, sorted(encodings)))} '
            f'({names}), only cdr can be read'
        )


def _topics(file: Path, *, use_index: bool) -> tuple[list[Topic], str | None, str]:
    """Return the topics of a file, a description of its damage or None, and one of its index's."""
    _require_mcap(file)
    indexed, remark = _topics_of_index(file) if use_index else (None, '')
    if indexed is not None:
        return indexed, None, ''
    channels: dict[int, tuple[Channel, Schema | None]] = {}
    counts: Counter[int] = Counter()
    damage = None
    try:
        for channel, _ in _stream(file, channels):
            counts[channel.id] += 1
    except _DamageError as error:
        channels = {}
        counts = Counter(channel.id for channel, _ in _intact(file, channels))
        damage = _damage_text(error, file)
    return [_topic(*channels[number], counts[number]) for number in channels], damage, remark


def _require_mcap(file: Path) -> None:
    try:
        with file.open('rb') as stream:
            start = stream.read(len(_MAGIC))
    except OSError as error:
        raise BagError(f'{file}: cannot be read: {error.strerror or error}') from error
    if start != _MAGIC:
        kind = kind_of_file(file)
        raise BagError(
            f'{file}: is not an MCAP file{f", but {kind}" if kind else ""}; name an .mcap file or '
            'a bag folder'
        )


def _topics_of_index(file: Path) -> tuple[list[Topic] | None, str]:
    """Return the topics in the index at the end of a file or None, and the index's damage."""
    summary, damage = read_summary(file)
    if summary is None or summary.statistics is None:
        return None, damage
    counts = summary.statistics.channel_message_counts
    topics = [
        _topic(channel, summary.schemas.get(channel.schema_id), counts.get(channel.id, 0))
        for channel in summary.channels.values()
    ]
    return topics, ''


def _topic(channel: Channel, schema: Schema | None, count: int) -> Topic:
    return Topic(
        name=channel.topic,
        msgtype=schema.name if schema else '',
        encoding=channel.message_encoding,
        count=count,
        schema_encoding=schema.encoding if schema else '',
        definition=schema.data.decode('utf-8', 'replace') if schema else '',
    )


def _stream(
    file: Path, channels: dict[int, tuple[Channel, Schema | None]] | None = None
) -> Iterator[tuple[Channel, Message]]:
    """
    Yield the messages of a file from its beginning; checks every CRC.

    channels : is filled with the channels and their schemas, by channel id
    :raises _DamageError: after the last intact message
    """
    channels = {} if channels is None else channels
    schemas: dict[int, Schema] = {}
    with file.open('rb') as stream:
        records = StreamReader(stream, validate_crcs=True).records
        while True:
            try:
                record = next(records, None)
                if isinstance(record, Message):
                    channel, _ = channels[record.channel_id]
            except READ_ERRORS as error:
                raise _DamageError(str(error) or type(error).__name__) from error
            if record is None or isinstance(record, DataEnd):
                # what follows is the index, which may be damaged
                return
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                channels[record.id] = record, schemas.get(record.schema_id)
            elif isinstance(record, Message):
                yield channel, record


def _intact(
    file: Path, channels: dict[int, tuple[Channel, Schema | None]] | None = None
) -> Iterator[tuple[Channel, Message]]:
    """
    Yield the messages of the intact parts of a damaged file; those of unknown topics are left out.

    channels : is filled with the channels and their schemas, by channel id
    """
    found, schemas = known_channels(file)
    if channels is not None:
        for number, channel in found.items():
            channels[number] = channel, schemas.get(channel.schema_id)
    for part in read_parts(file):
        for record in part.records if isinstance(part, IntactPart) else ():
            if isinstance(record, Message) and record.channel_id in found:
                yield found[record.channel_id], record


def _raw(topic: str, index: int, message: Message) -> RawMessage:
    return RawMessage(topic=topic, index=index, log_time_ns=message.log_time, data=message.data)


def _damage_text(error: _DamageError, file: Path) -> str:
    counts = Counter(channel.topic for channel, _ in _intact(file))
    per_topic = ', '.join(f'{count} on {name}' for name, count in sorted(counts.items()))
    fault = 'is cut off' if is_cut_off(file) else f'is damaged ({error})'
    return (
        f'{file}: the file {fault}; {counts.total()} messages can be read'
        f'{f" ({per_topic})" if per_topic else ""}'
    )


def _refusal(damage: str) -> str:
    return f'{damage}; copy the file again{_SALVAGE_ADVICE}'
