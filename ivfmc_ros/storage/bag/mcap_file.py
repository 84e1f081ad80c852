# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reads one MCAP file: its topics and messages; finds damage and what is intact behind it."""

from collections import Counter
from collections.abc import Collection
from collections.abc import Iterator
from pathlib import Path

from mcap.records import Channel
from mcap.records import Message
from mcap.records import Schema

from ivfmc_ros.storage.bag import mcap_layout
from ivfmc_ros.storage.bag.bag_file import Encoded
from ivfmc_ros.storage.bag.bag_file import FileContents
from ivfmc_ros.storage.bag.bag_file import FileDamage
from ivfmc_ros.storage.bag.bag_file import Topic
from ivfmc_ros.storage.bag.mcap_records import file_records
from ivfmc_ros.storage.bag.recovery import IntactPart
from ivfmc_ros.storage.bag.recovery import known_channels
from ivfmc_ros.storage.bag.recovery import read_parts
from ivfmc_ros.storage.bag.summary import is_cut_off
from ivfmc_ros.storage.bag.summary import READ_ERRORS
from ivfmc_ros.storage.bag.summary import read_summary

MAGIC = mcap_layout.MAGIC

_Channels = dict[int, tuple[Channel, Schema | None]]
# Channel, log time in nanoseconds, and data.
_Found = tuple[Channel, int, Encoded]


def read_contents(file: Path, *, use_index: bool) -> FileContents:
    """Return the topics of a file, as ``BagFormat`` says."""
    indexed, remark = _topics_of_index(file) if use_index else (None, '')
    if indexed is not None:
        return FileContents(topics=indexed)
    channels: _Channels = {}
    counts: Counter[int] = Counter()
    fault = ''
    try:
        for channel, _, _ in _stream(file, channels):
            counts[channel.id] += 1
    except FileDamage as damage:
        channels = {}
        counts = Counter(channel.id for channel, _, _ in _intact(file, channels))
        fault = str(damage)
    topics = [_topic(*channels[number], counts[number]) for number in channels]
    return FileContents(topics=topics, fault=fault, remark=remark)


def read_messages(
    file: Path,
    topics: Collection[str] | None,
    *,
    salvage: bool,
    validate_crcs: bool = True,
) -> Iterator[tuple[str, int, Encoded]]:
    """
    Yield all messages of a file in the order in which they were written, as ``BagFormat`` says.

    Messages of topics that are not in the index are among them.

    :raises FileDamage: without ``salvage``, after the last intact message
    """
    found = _intact(file) if salvage else _stream(file, {}, validate_crcs=validate_crcs)
    for channel, log_time_ns, data in found:
        yield channel.topic, log_time_ns, data


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


def _stream(file: Path, channels: _Channels, *, validate_crcs: bool = True) -> Iterator[_Found]:
    """
    Yield the messages of a file from its beginning.

    channels : is filled with the channels and their schemas, by channel id
    validate_crcs : check those of the chunks and of the data section
    :raises FileDamage: after the last intact message
    """
    schemas: dict[int, Schema] = {}
    records = file_records(file, validate_crcs=validate_crcs)
    while True:
        try:
            record = next(records, None)
            if isinstance(record, tuple):
                channel, _ = channels[record[0]]
        except READ_ERRORS as error:
            reason = str(error) or type(error).__name__
            text = 'is cut off' if is_cut_off(file) else f'is damaged ({reason})'
            raise FileDamage(text) from error
        if record is None:
            return
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel):
            channels[record.id] = record, schemas.get(record.schema_id)
        else:
            yield channel, *record[1:]


def _intact(file: Path, channels: _Channels | None = None) -> Iterator[_Found]:
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
                yield found[record.channel_id], record.log_time, record.data
