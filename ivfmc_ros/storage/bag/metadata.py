# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``metadata.yaml``, by which rosbag2 knows what a bag folder holds."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from ivfmc_ros.errors import BagError
from ivfmc_ros.storage.messages import cdr

FILE_NAME = 'metadata.yaml'

# the version that rosbag2 of Jazzy writes
VERSION = 9
ROS_DISTRO = 'jazzy'

_FOREVER = {'sec': 9223372036, 'nsec': 854775807}


@dataclass(frozen=True, kw_only=True)
class Channel:
    """
    A topic of a bag that is being written.

    latched : its publisher keeps the last message for those who come late (transient local)
    depth : of its publisher's history
    """

    topic: str
    msgtype: str
    count: int = 0
    type_hash: str = ''
    latched: bool = False
    depth: int = 30


def qos(channel: Channel) -> list[dict[str, object]]:
    """Return the offered QoS profiles of a topic as rosbag2 stores them."""
    return [
        {
            'history': 'keep_last',
            'depth': channel.depth,
            'reliability': 'reliable',
            'durability': 'transient_local' if channel.latched else 'volatile',
            'deadline': dict(_FOREVER),
            'lifespan': dict(_FOREVER),
            'liveliness': 'automatic',
            'liveliness_lease_duration': dict(_FOREVER),
            'avoid_ros_namespace_conventions': False,
        }
    ]


def information(
    file_name: str, channels: Sequence[Channel], start_ns: int, end_ns: int
) -> dict[str, object]:
    """Return what rosbag2 wants to know of a bag of one file; stamps in nanoseconds."""
    span = {
        'starting_time': {'nanoseconds_since_epoch': start_ns},
        'duration': {'nanoseconds': end_ns - start_ns},
        'message_count': sum(channel.count for channel in channels),
    }
    return {
        'version': VERSION,
        'storage_identifier': 'mcap',
        **span,
        'topics_with_message_count': [_topic(channel) for channel in channels],
        'compression_format': '',
        'compression_mode': '',
        'relative_file_paths': [file_name],
        'files': [{'path': file_name, **span}],
        'custom_data': None,
        'ros_distro': ROS_DISTRO,
    }


def _topic(channel: Channel) -> dict[str, object]:
    return {
        'topic_metadata': {
            'name': channel.topic,
            'type': channel.msgtype,
            'serialization_format': cdr.ENCODING,
            'offered_qos_profiles': qos(channel),
            'type_description_hash': channel.type_hash,
        },
        'message_count': channel.count,
    }


def dump(document: object) -> str:
    """Return YAML as yaml-cpp reads it: without anchors for what occurs twice."""
    return yaml.dump(document, Dumper=_Plain, sort_keys=False)


class _Plain(yaml.SafeDumper):
    def ignore_aliases(self, data: object) -> bool:
        return True


def bag_files(folder: Path) -> list[Path]:
    """
    Return the MCAP files of a bag folder in their order.

    :raises BagError: there is no usable metadata.yaml, or the bag is stored otherwise
    """
    path = folder / FILE_NAME
    info = _read(path)
    storage = info.get('storage_identifier')
    if storage != 'mcap':
        raise BagError(
            f'{path}: the bag is stored as {storage!r}, only mcap can be read; '
            'convert it with ros2 bag convert'
        )
    if info.get('compression_mode'):
        raise BagError(
            f'{path}: rosbag2 compressed the bag by {info["compression_mode"]}; convert it with '
            'ros2 bag convert to one without (chunks of the MCAP may be compressed)'
        )
    names = info.get('relative_file_paths')
    if not isinstance(names, list) or not names:
        raise BagError(f'{path}: relative_file_paths: must be a list of files')
    return [folder / str(name) for name in names]


def _read(path: Path) -> dict[str, Any]:
    try:
        document = yaml.safe_load(path.read_text(encoding='utf-8'))
    except FileNotFoundError:
        raise BagError(
            f'{path.parent}: has no {FILE_NAME} and is no bag; name an .mcap file or a bag folder'
        ) from None
    except OSError as error:
        raise BagError(f'{path}: cannot be read: {error.strerror or error}') from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise BagError(f'{path}: is not YAML: {error}') from error
    info = document.get('rosbag2_bagfile_information') if isinstance(document, dict) else None
    if not isinstance(info, dict):
        raise BagError(f'{path}: rosbag2_bagfile_information: is missing')
    return info
