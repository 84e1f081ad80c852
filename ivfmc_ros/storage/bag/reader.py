# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reads bags of any recorder and format; detects damage and salvages what is intact."""

from collections import Counter
from collections.abc import Callable
from collections.abc import Collection
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ivfmc_ros.errors import BagError
from ivfmc_ros.file_kinds import kind_of_file
from ivfmc_ros.storage.bag import mcap_file
from ivfmc_ros.storage.bag import metadata
from ivfmc_ros.storage.bag import ros1_file
from ivfmc_ros.storage.bag import sqlite_file
from ivfmc_ros.storage.bag.bag_file import BagFormat
from ivfmc_ros.storage.bag.bag_file import Encoded
from ivfmc_ros.storage.bag.bag_file import FileContents
from ivfmc_ros.storage.bag.bag_file import FileDamage
from ivfmc_ros.storage.bag.bag_file import RawMessage
from ivfmc_ros.storage.bag.bag_file import Topic
from ivfmc_ros.storage.bag.decompression import content_of
from ivfmc_ros.storage.bag.decompression import FileContent
from ivfmc_ros.storage.bag.decompression import plain_message
from ivfmc_ros.storage.bag.locate import find_files
from ivfmc_ros.storage.bag.locate import is_unfinished
from ivfmc_ros.storage.messages import cdr

_FORMATS: tuple[BagFormat, ...] = (mcap_file, sqlite_file, ros1_file)
_SALVAGE_ADVICE = ', or use what can be read (--salvage)'


@dataclass(frozen=True, kw_only=True)
class Bag:
    """
    A bag: one file, or the files of a split recording in order.

    path : as the user named it, for error messages
    topics : by name
    damage : description of the damage of a bag that was opened for salvage, or None
    remarks : what was missing or damaged and did not prevent reading, damage included
    """

    path: Path
    files: tuple[FileContent, ...]
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

    def messages(
        self, topics: Collection[str], *, validate_crcs: bool = True
    ) -> Iterator[RawMessage]:
        """
        Yield the messages of some topics in the order in which they were written.

        validate_crcs : False where all messages of the bag were read before
        :raises BagError: the bag is damaged and was not opened for salvage, or its messages do
            not agree with its index
        """
        seen: Counter[str] = Counter()
        for file in self.files:
            with file.named_errors():
                found = self._records(file.path, topics, validate_crcs=validate_crcs)
                for topic, log_time_ns, data in found:
                    index = seen[topic]
                    seen[topic] += 1
                    plain = plain_message(data, f'{file.path}: {topic}', index)
                    yield RawMessage(topic=topic, index=index, log_time_ns=log_time_ns, data=plain)
        if self.damage is None:
            self._require_counts(seen, topics)

    def _records(
        self, file: Path, topics: Collection[str], *, validate_crcs: bool
    ) -> Iterator[tuple[str, int, Encoded]]:
        """Yield topic, log time in nanoseconds and data of the messages of one file."""
        salvage = self.damage is not None
        try:
            found = format_of(file).read_messages(
                file, topics, salvage=salvage, validate_crcs=validate_crcs
            )
            for record in found:
                if record[0] not in self.topics:
                    raise BagError(
                        f'{file}: is damaged: topic {record[0]} is in the messages, not in the '
                        f'index; copy the file again{_SALVAGE_ADVICE}'
                    )
                if record[0] in topics:
                    yield record
        except FileDamage as damage:
            raise BagError(_refusal(_damage_text(file, str(damage)))) from damage

    def _require_counts(self, seen: Counter[str], topics: Collection[str]) -> None:
        for name in topics:
            counted = self.topics[name].count if name in self.topics else 0
            if seen[name] != counted:
                raise BagError(
                    f'{self.path}: is damaged: topic {name} has {seen[name]} messages, its index '
                    f'lists {counted}; copy the file again{_SALVAGE_ADVICE}'
                )


def open_bag(path: Path, *, salvage: bool = False) -> Bag:
    """
    Open a bag folder, or an ``.mcap``, ``.db3`` or ``.bag`` file.

    A recording that was not finished (``scan.mcap.part``), or whose ``metadata.yaml`` is missing,
    is read as far as it goes; ``Bag.remarks`` says so.
    What rosbag2 compressed by zstd is decompressed.

    salvage : accept any damaged bag; ``Bag.damage`` describes the damage
    :raises BagError: the path is not a bag, the bag is damaged, or its encoding is not supported
    """
    found, missing = find_files(path)
    files = tuple(map(content_of, found))
    topics: dict[str, Topic] = {}
    damage = None
    remarks = [missing] if missing else []
    for file in files:
        # a recording that was not finished is cut off at its last chunk
        accept = salvage or is_unfinished(file.path)
        contents, file_damage = _read_contents(file, accept=accept)
        if file_damage and not accept:
            raise BagError(_refusal(file_damage))
        damage = damage or file_damage or None
        if file_damage or contents.remark:
            remarks.append(file_damage or file.named(contents.remark))
        for topic in contents.topics:
            _add(topics, topic)
    _require_cdr(path, topics)
    remarks += _metadata_remarks(path, topics)
    return Bag(
        path=path,
        files=files,
        topics=topics,
        damage=damage,
        remarks=tuple(remarks),
    )


def _read_contents(file: FileContent, *, accept: bool) -> tuple[FileContents, str]:
    """Return the topics of a file and its damage, '' where it has none."""
    path = file.path
    try:
        with file.named_errors():
            contents = format_of(path).read_contents(path, use_index=not accept)
            damage = _damage_text(path, contents.fault) if contents.fault else ''
    except OSError as error:  # such as a recording that was renamed when it ended
        raise BagError(f'{file.source}: cannot be read: {error.strerror or error}') from error
    return contents, file.named(damage)


def _metadata_remarks(path: Path, topics: dict[str, Topic]) -> list[str]:
    if not (path / metadata.FILE_NAME).is_file():
        return []
    counts = {topic.name: topic.count for topic in topics.values()}
    found = metadata.contradiction(path, counts)
    return [f'{found}; the files are read'] if found else []


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


def format_of(file: Path) -> BagFormat:
    """
    Return the module that reads a file.

    :raises BagError: the file cannot be read, or is not of a bag
    """
    try:
        with file.open('rb') as stream:
            start = stream.read(max(len(known.MAGIC) for known in _FORMATS))
    except OSError as error:
        raise BagError(f'{file}: cannot be read: {error.strerror or error}') from error
    for known in _FORMATS:
        if start.startswith(known.MAGIC):
            return known
    kind = kind_of_file(file)
    raise BagError(
        f'{file}: is not a bag file{f", but {kind}" if kind else ""}; name an .mcap, .db3 or '
        '.bag file, or a bag folder'
    )


def _damage_text(file: Path, fault: str) -> str:
    source = format_of(file).read_messages(file, None, salvage=True)
    counts = Counter(topic for topic, _, _ in source)
    per_topic = ', '.join(f'{count} on {name}' for name, count in sorted(counts.items()))
    return (
        f'{file}: the file {fault}; {counts.total()} messages can be read'
        f'{f" ({per_topic})" if per_topic else ""}'
    )


def _refusal(damage: str) -> str:
    return f'{damage}; copy the file again{_SALVAGE_ADVICE}'
