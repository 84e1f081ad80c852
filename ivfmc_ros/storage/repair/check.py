# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Checks a recording without changing it: CRCs, index, metadata.yaml, and what is missing.

A recording is a bag folder, the folder of a scan, or one file, finished or not.
"""

from collections import Counter
from collections import defaultdict
from collections.abc import Callable
from collections.abc import Mapping
from dataclasses import dataclass
from dataclasses import field
from pathlib import Path
from typing import Any

from mcap.records import Channel
from mcap.records import Header
from mcap.records import Message
from mcap.records import Schema

from ivfmc_ros.errors import BagError
from ivfmc_ros.errors import MessageError
from ivfmc_ros.storage.bag import mcap_file
from ivfmc_ros.storage.bag import metadata
from ivfmc_ros.storage.bag import sqlite_file
from ivfmc_ros.storage.bag.decompression import content_of
from ivfmc_ros.storage.bag.decompression import FileContent
from ivfmc_ros.storage.bag.decompression import SUFFIXES
from ivfmc_ros.storage.bag.locate import find_files
from ivfmc_ros.storage.bag.locate import is_unfinished
from ivfmc_ros.storage.bag.reader import format_of
from ivfmc_ros.storage.bag.reader import open_bag
from ivfmc_ros.storage.bag.recovery import DamagedPart
from ivfmc_ros.storage.bag.recovery import IntactPart
from ivfmc_ros.storage.bag.recovery import known_channels
from ivfmc_ros.storage.bag.recovery import read_parts
from ivfmc_ros.storage.bag.summary import is_cut_off
from ivfmc_ros.storage.bag.summary import read_summary
from ivfmc_ros.storage.bag.unfinished_mcap import LIBRARY
from ivfmc_ros.storage.messages import cdr
from ivfmc_ros.storage.messages.profile_header import ProfileHeader
from ivfmc_ros.storage.messages.profile_header import read_profile_header
from ivfmc_ros.storage.messages.sensor_messages import POINT_CLOUD
from ivfmc_ros.storage.repair.missing_profiles import find_missing_profiles
from ivfmc_ros.storage.repair.missing_profiles import MissingProfiles
from ivfmc_ros.storage.repair.missing_profiles import ProfilePlace


@dataclass(frozen=True, kw_only=True)
class FileCheck:
    """
    What one file of a recording has.

    content : of the file; one that is compressed as a whole was decompressed
    chunks, unchecked : number of intact chunks, and of those of them without a CRC
    loose : number of messages outside of chunks, which have no CRC of their own
    messages : number of readable messages by topic
    lost : number of messages by topic that are known to be lost
    unknown : number of messages whose topic is not known, because its description is lost
    damaged : parts of an MCAP file that cannot be read
    faults : what is damaged in a file of another format
    index : what is wrong with the end of the file (index), '' where it is right
    profiles : headers of the profiles by seq
    """

    path: Path
    content: FileContent
    chunks: int = 0
    unchecked: int = 0
    loose: int = 0
    messages: Mapping[str, int] = field(default_factory=dict)
    lost: Mapping[str, int] = field(default_factory=dict)
    unknown: int = 0
    damaged: tuple[DamagedPart, ...] = ()
    faults: tuple[str, ...] = ()
    index: str = ''
    profiles: Mapping[int, ProfileHeader] = field(default_factory=dict)

    @property
    def is_sound(self) -> bool:
        """Whether nothing is damaged and the index is right."""
        return not (self.damaged or self.faults or self.index or self.unknown)


@dataclass(frozen=True, kw_only=True)
class RecordingCheck:
    """
    What a recording has, and what it lacks.

    metadata : what is wrong with metadata.yaml, '' where it is right or not needed
    missing : profiles that are not in the files
    missing_views : views that were planned and have no profile
    """

    path: Path
    files: tuple[FileCheck, ...]
    metadata: str = ''
    missing: tuple[MissingProfiles, ...] = ()
    missing_views: tuple[int, ...] = ()

    @property
    def is_sound(self) -> bool:
        """Whether the files can be read as they are; profiles may be missing all the same."""
        return not self.metadata and all(file.is_sound for file in self.files)

    @property
    def is_complete(self) -> bool:
        """Whether no message is known to be missing."""
        lost = any(file.lost or file.unknown for file in self.files)
        return not lost and not self.missing and not self.missing_views

    @property
    def messages(self) -> dict[str, int]:
        """Number of readable messages by topic."""
        return dict(sum((Counter(file.messages) for file in self.files), Counter()))

    @property
    def lost(self) -> dict[str, int]:
        """Number of messages by topic that are known to be lost."""
        return dict(sum((Counter(file.lost) for file in self.files), Counter()))

    def lines(self) -> list[str]:
        """Return what is wrong, a sentence each, for a person."""
        found = [self.metadata] if self.metadata else []
        for file in self.files:
            found += [f'{file.path}: {part}' for part in (*file.damaged, *file.faults)]
            found += [file.index] if file.index else []
            if file.unknown:
                found.append(
                    f'{file.path}: {file.unknown} messages are of topics whose description is lost'
                )
            if file.unchecked or file.loose:
                found.append(
                    f'{file.path}: {file.unchecked} chunks and {file.loose} messages outside of '
                    'chunks have no CRC and cannot be checked'
                )
        found += [f'lost: {count} messages of {topic}' for topic, count in self.lost.items()]
        found += [f'missing: {run}' for run in self.missing]
        found += [f'missing: view {view} has no profile' for view in self.missing_views]
        return found


def check_recording(
    path: Path,
    acknowledged: Mapping[int, ProfilePlace] | None = None,
    planned_views: int = 0,
) -> RecordingCheck:
    """
    Check a recording; every byte is read once.

    acknowledged : profiles of the catalogue by seq
    planned_views : number of views of the scan, 0 where it is not known
    :raises BagError: there is no recording, or a file cannot be read
    """
    try:
        paths, _ = find_files(path)
        fault = ''
    except BagError as error:
        paths, fault = _without_metadata(path), str(error)
        if not paths:
            raise
    checks = tuple(check_file(file) for file in paths)
    if path.is_dir() and not fault and not any(map(is_unfinished, paths)):
        fault = _metadata_fault(path, checks)
    profiles = {seq: header for check in checks for seq, header in check.profiles.items()}
    seen = {header.view for header in profiles.values()}
    return RecordingCheck(
        path=path,
        files=checks,
        metadata=fault,
        missing=find_missing_profiles(profiles, acknowledged or {}),
        missing_views=tuple(view for view in range(planned_views) if view not in seen),
    )


def _without_metadata(folder: Path) -> tuple[Path, ...]:
    """Return the files of a folder whose metadata.yaml cannot be used."""
    if not folder.is_dir() or not (folder / metadata.FILE_NAME).exists():
        return ()
    plain = ('*.mcap', '*.mcap.part', '*.db3', '*.bag')
    compressed = (f'{pattern}{end}' for pattern in plain for end in SUFFIXES)
    found = (sorted(folder.glob(pattern)) for pattern in (*plain, *compressed))
    return tuple(next(filter(None, found), ()))


def _metadata_fault(folder: Path, checks: tuple[FileCheck, ...]) -> str:
    """Return how metadata.yaml differs from the files, '' where it does not."""
    path = folder / metadata.FILE_NAME
    if not path.exists():
        return f'{path}: is missing'
    counted = dict(sum((Counter(check.messages) for check in checks), Counter()))
    return metadata.contradiction(folder, counted)


def check_file(file: Path) -> FileCheck:
    """
    Check one file.

    :raises BagError: it cannot be read, or is not of a bag
    """
    content = content_of(file)
    with content.named_errors():
        found = format_of(content.path)
        if found is not mcap_file:
            faults = sqlite_file.structure_faults(content.path) if found is sqlite_file else []
            return _check_other_format(content, list(map(content.named, faults)))
        reading = _Reading(*known_channels(content.path))
        for part in read_parts(content.path):
            reading.add(part)
        return reading.result(content)


def _check_other_format(content: FileContent, faults: list[str]) -> FileCheck:
    bag = open_bag(content.source, salvage=True)
    decoders = {
        name: bag.decoder(name)
        for name, topic in bag.topics.items()
        if name.endswith('/profile') and cdr.full_name(topic.msgtype) == POINT_CLOUD
    }
    counts: Counter[str] = Counter()
    headers = {}
    for raw in bag.messages(bag.topics):
        counts[raw.topic] += 1
        header = _profile_header(decoders.get(raw.topic), raw)
        if header is not None:
            headers[header.seq] = header
    return FileCheck(
        path=content.source,
        content=content,
        messages=dict(counts),
        loose=counts.total(),
        faults=tuple(filter(None, [bag.damage, *faults])),
        profiles=headers,
    )


def _profile_header(decode: Callable[[Any], Any] | None, message: Any) -> ProfileHeader | None:
    """Return the header of a profile, None where the message is not one."""
    if decode is None:
        return None
    try:
        return read_profile_header(decode(message))
    except (BagError, MessageError):
        return None


class _Reading:
    """Collects what the parts of a file hold."""

    def __init__(self, channels: Mapping[int, Channel], schemas: Mapping[int, Schema]) -> None:
        self._channels = channels
        self._profiles = _ProfileTopics(channels, schemas)
        self._counts: Counter[str] = Counter()
        self._sequences: defaultdict[str, int] = defaultdict(int)
        self._parts: Counter[str] = Counter()
        self._damaged: list[DamagedPart] = []
        self._headers: dict[int, ProfileHeader] = {}
        self._is_ours = False

    def add(self, part: IntactPart | DamagedPart) -> None:
        if isinstance(part, DamagedPart):
            self._damaged.append(part)
            return
        self._parts['chunks'] += part.is_chunk
        self._parts['unchecked'] += part.is_chunk and not part.is_checked
        for record in part.records:
            if isinstance(record, Header):
                self._is_ours = record.library == LIBRARY
            elif isinstance(record, Message):
                self._parts['loose'] += not part.is_chunk
                self._add_message(record)

    def _add_message(self, message: Message) -> None:
        channel = self._channels.get(message.channel_id)
        if channel is None:
            self._parts['unknown'] += 1
            return
        self._counts[channel.topic] += 1
        following = max(self._sequences[channel.topic], message.sequence + 1)
        self._sequences[channel.topic] = following
        header = self._profiles.header(message)
        if header is not None:
            self._headers[header.seq] = header

    def result(self, content: FileContent) -> FileCheck:
        stated, index = _stated(content.path, self._channels)
        lost = {}
        for topic in sorted({*self._counts, *stated}):
            whole = max(stated.get(topic, 0), self._sequences[topic] if self._is_ours else 0)
            if whole > self._counts[topic]:
                lost[topic] = whole - self._counts[topic]
        return FileCheck(
            path=content.source,
            content=content,
            messages=dict(self._counts),
            lost=lost,
            damaged=tuple(self._damaged),
            index=content.named(index),
            profiles=self._headers,
            chunks=self._parts['chunks'],
            unchecked=self._parts['unchecked'],
            loose=self._parts['loose'],
            unknown=self._parts['unknown'],
        )


class _ProfileTopics:
    """Decodes the headers of the messages on topics that can hold profiles."""

    def __init__(self, channels: Mapping[int, Channel], schemas: Mapping[int, Schema]) -> None:
        self._decoders = {}
        for number, channel in channels.items():
            schema = schemas.get(channel.schema_id)
            is_cloud = schema is not None and cdr.full_name(schema.name) == POINT_CLOUD
            if schema is None or not is_cloud or not channel.topic.endswith('/profile'):
                continue
            text = schema.data.decode('utf-8', 'replace')
            try:
                self._decoders[number] = cdr.decoder(schema.name, schema.encoding, text)
            except BagError:
                # another program's cloud, whose definition is not usable
                continue

    def header(self, message: Message) -> ProfileHeader | None:
        """Return the header of a profile, None where the message is not one."""
        return _profile_header(self._decoders.get(message.channel_id), message.data)


def _stated(file: Path, channels: Mapping[int, Channel]) -> tuple[dict[str, int], str]:
    """Return the counts by topic in the index of a file, and what is wrong with the index."""
    if is_cut_off(file):
        return {}, f'{file}: the recording was not finished: it has no index'
    summary, fault = read_summary(file)
    if summary is None or summary.statistics is None:
        return {}, fault
    counts: Counter[str] = Counter()
    for number, count in summary.statistics.channel_message_counts.items():
        channel = summary.channels.get(number) or channels.get(number)
        if channel is not None:
            counts[channel.topic] += count
    return dict(counts), fault
