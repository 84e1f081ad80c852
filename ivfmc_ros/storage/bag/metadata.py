# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reads and writes ``metadata.yaml``, the description of a bag folder for rosbag2."""

from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from pathlib import PurePath
from typing import Any

import yaml

from ivfmc_ros.errors import BagError
from ivfmc_ros.storage.messages import cdr

FILE_NAME = 'metadata.yaml'
_STORAGES = ('mcap', 'sqlite3')
_COMPRESSION_MODES = ('', 'none', 'file', 'message')

# Version of the format that rosbag2 of ROS 2 Jazzy writes.
VERSION = 9
ROS_DISTRO = 'jazzy'

# The maximum of a signed 64-bit time in nanoseconds, rmw's infinite duration.
_INFINITE = {'sec': 9223372036, 'nsec': 854775807}


@dataclass(frozen=True, kw_only=True)
class TopicMetadata:
    """
    Description of a topic that is written.

    msgtype : such as 'sensor_msgs/msg/Image'
    count : number of messages
    type_hash : RIHS01 hash of the message definition (REP 2011); '' for an unknown type
    latched : the publisher is transient local
    depth : history depth of the publisher
    qos : offered QoS profiles as another recorder stored them, YAML; '' for those of this package
    """

    topic: str
    msgtype: str
    count: int = 0
    type_hash: str = ''
    latched: bool = False
    depth: int = 30
    qos: str = ''


def offered_qos_profiles(topic: TopicMetadata) -> list[dict[str, object]]:
    """Return the offered QoS profiles of a topic as rosbag2 stores them."""
    if topic.qos:
        try:
            stored = yaml.safe_load(topic.qos)
        except yaml.YAMLError:
            stored = None
        return stored if isinstance(stored, list) else []
    return [
        {
            'history': 'keep_last',
            'depth': topic.depth,
            'reliability': 'reliable',
            'durability': 'transient_local' if topic.latched else 'volatile',
            'deadline': dict(_INFINITE),
            'lifespan': dict(_INFINITE),
            'liveliness': 'automatic',
            'liveliness_lease_duration': dict(_INFINITE),
            'avoid_ros_namespace_conventions': False,
        }
    ]


@dataclass(frozen=True, kw_only=True)
class FileMetadata:
    """
    Description of a file that is written.

    name : relative to the folder of the bag
    start_ns, end_ns : smallest and greatest log time, nanoseconds
    count : number of messages
    """

    name: str
    start_ns: int
    end_ns: int
    count: int


def bag_information(
    files: Sequence[FileMetadata], topics: Sequence[TopicMetadata]
) -> dict[str, object]:
    """Return the value of ``rosbag2_bagfile_information`` for the files of a bag, in order."""
    used = [file for file in files if file.count]
    start_ns = min((file.start_ns for file in used), default=0)
    end_ns = max((file.end_ns for file in used), default=0)
    return {
        'version': VERSION,
        'storage_identifier': 'mcap',
        **_span(start_ns, end_ns, sum(topic.count for topic in topics)),
        'topics_with_message_count': [_topic_entry(topic) for topic in topics],
        'compression_format': '',
        'compression_mode': '',
        'relative_file_paths': [file.name for file in files],
        'files': [
            {'path': file.name, **_span(file.start_ns, file.end_ns, file.count)} for file in files
        ],
        'custom_data': None,
        'ros_distro': ROS_DISTRO,
    }


def _span(start_ns: int, end_ns: int, count: int) -> dict[str, object]:
    return {
        'starting_time': {'nanoseconds_since_epoch': start_ns},
        'duration': {'nanoseconds': end_ns - start_ns},
        'message_count': count,
    }


def stated_counts(folder: Path) -> dict[str, int]:
    """
    Return the number of messages by topic that metadata.yaml states.

    :raises BagError: metadata.yaml is missing or invalid
    """
    entries = _read(folder / FILE_NAME).get('topics_with_message_count')
    counts = {}
    for entry in entries if isinstance(entries, list) else []:
        try:
            counts[str(entry['topic_metadata']['name'])] = int(entry['message_count'])
        except (KeyError, TypeError, ValueError) as error:
            raise BagError(
                f'{folder / FILE_NAME}: topics_with_message_count: is not valid: {error}'
            ) from error
    return {topic: count for topic, count in counts.items() if count}


def _topic_entry(topic: TopicMetadata) -> dict[str, object]:
    return {
        'topic_metadata': {
            'name': topic.topic,
            'type': topic.msgtype,
            'serialization_format': cdr.ENCODING,
            'offered_qos_profiles': offered_qos_profiles(topic),
            'type_description_hash': topic.type_hash,
        },
        'message_count': topic.count,
    }


def dump(document: object) -> str:
    """Return YAML without anchors and aliases, which yaml-cpp in rosbag2 does not expand."""
    return yaml.dump(document, Dumper=_DumperWithoutAliases, sort_keys=False)


class _DumperWithoutAliases(yaml.SafeDumper):
    def ignore_aliases(self, data: object) -> bool:
        return True


def bag_files(folder: Path) -> list[Path]:
    """
    Return the files of a bag folder in recording order.

    :raises BagError: metadata.yaml is missing or invalid, or the bag is not plain MCAP or SQLite
    """
    path = folder / FILE_NAME
    info = _read(path)
    storage = info.get('storage_identifier')
    # ros2 bag reindex leaves the identifier empty; the files say what they are
    if storage and storage not in _STORAGES:
        raise BagError(
            f'{path}: the bag is stored as {storage!r}, only {" and ".join(_STORAGES)} can be '
            'read; convert it with ros2 bag convert'
        )
    _require_compression(path, info)
    names = info.get('relative_file_paths')
    if not isinstance(names, list) or not names:
        raise BagError(f'{path}: relative_file_paths: must be a list of files')
    # ROS 2 Dashing wrote the folder before the name; no file outside of the bag belongs to it
    files = [folder / PurePath(str(name)).name for name in names]
    twice = [file.name for file in files if files.count(file) > 1]
    if twice:
        raise BagError(f'{path}: relative_file_paths: has {twice[0]} more than once')
    return files


def _require_compression(path: Path, info: Mapping[str, Any]) -> None:
    mode = str(info.get('compression_mode') or '').lower()
    method = str(info.get('compression_format') or '').lower()
    if mode not in _COMPRESSION_MODES or (mode not in ('', 'none') and method != 'zstd'):
        raise BagError(
            f'{path}: rosbag2 compressed the bag by {info.get("compression_mode")!r} '
            f'{info.get("compression_format")!r}, only file and message by zstd can be read; '
            'convert it with ros2 bag convert'
        )


def contradiction(folder: Path, counts: Mapping[str, int]) -> str:
    """
    Return in what metadata.yaml differs from the files of a bag, '' where it does not.

    counts : number of messages by topic that the files have
    """
    path = folder / FILE_NAME
    try:
        stated = stated_counts(folder)
    except BagError as error:
        return str(error)
    for topic in sorted(stated.keys() | counts.keys()):
        if stated.get(topic, 0) != counts.get(topic, 0):
            return (
                f'{path}: states {stated.get(topic, 0)} messages of {topic}, the files have '
                f'{counts.get(topic, 0)}'
            )
    return ''


def not_a_bag_error(folder: Path) -> BagError:
    """Return the error for a folder without bag files."""
    return BagError(
        f'{folder}: has no {FILE_NAME} and is not a bag; name an .mcap, .db3 or .bag '
        'file, or a bag folder'
    )


def _read(path: Path) -> dict[str, Any]:
    try:
        # a byte-order mark may precede the text
        document = yaml.safe_load(path.read_text(encoding='utf-8-sig'))
    except FileNotFoundError:
        raise not_a_bag_error(path.parent) from None
    except OSError as error:
        raise BagError(f'{path}: cannot be read: {error.strerror or error}') from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise BagError(f'{path}: is not valid YAML: {error}') from error
    info = document.get('rosbag2_bagfile_information') if isinstance(document, dict) else None
    if not isinstance(info, dict):
        raise BagError(f'{path}: rosbag2_bagfile_information: is missing')
    return info
