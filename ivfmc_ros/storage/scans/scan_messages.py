# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reads the messages of a scan from a bag, except its images."""

from collections.abc import Callable
from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ivfmc_ros.errors import BagError
from ivfmc_ros.errors import MessageError
from ivfmc_ros.storage.bag.bag_file import RawMessage
from ivfmc_ros.storage.bag.bag_file import Topic
from ivfmc_ros.storage.bag.reader import Bag
from ivfmc_ros.storage.bag.topics import ScanTopics
from ivfmc_ros.storage.matching.table_transforms import child_frames
from ivfmc_ros.storage.matching.table_transforms import table_states
from ivfmc_ros.storage.messages import cdr
from ivfmc_ros.storage.messages.profile_header import ProfileHeader
from ivfmc_ros.storage.messages.profile_header import read_profile_header
from ivfmc_ros.storage.messages.sensor_messages import TF_MESSAGE


def received_remarks(path: Path, *, received: bool) -> tuple[str, ...]:
    """Return what is said of a bag that is read by the times of recording."""
    if not received:
        return ()
    text = (
        'the times at which messages were recorded are used for their stamps: table angles are '
        'off by the speed of the table times the delay of the pictures'
    )
    return (f'{path}: {text}',)


def recorded_profile_headers(bag: Bag, topic: str) -> dict[int, ProfileHeader]:
    """Return the headers of the recorded profiles by stamp; clouds of other types are ignored."""
    decode = bag.decoder(topic)
    headers = (_profile_header(decode(raw)) for raw in bag.messages([topic]))
    return {header.stamp_ns: header for header in headers if header is not None}


def _profile_header(message: Any) -> ProfileHeader | None:
    try:
        return read_profile_header(message)
    except MessageError:
        # another program's cloud on a topic of that name
        return None


# What is stored of the messages of a role; the whole message by default. The time at which a
# message was recorded is stored beside the stamp where clocks are compared.
_REDUCTIONS: Mapping[str, Callable[[Any, RawMessage], Any]] = {
    'image': lambda message, raw: (cdr.stamp_ns(message), raw.log_time_ns),
    'joint_states': lambda message, raw: (message, raw.log_time_ns),
    'profile': lambda message, _: _profile_header(message),
}


def read_messages(bag: Bag, topics: ScanTopics, *, received: bool) -> dict[str, list[Any]]:
    """
    Return all messages by role; of images the stamps, of profiles the headers.

    received : the times of recording replace the stamps
    """
    names = {role: topic.name for role, topic in vars(topics).items() if topic is not None}
    decoders = {name: bag.decoder(name) for name in names.values()}
    role_of = {name: role for role, name in names.items()}
    messages: dict[str, list[Any]] = {role: [] for role in vars(topics)}
    for raw in bag.messages(role_of.keys()):
        role = role_of[raw.topic]
        if role == 'camera_info' and messages[role]:
            continue
        message = decoders[raw.topic](raw)
        if received and hasattr(message, 'header'):
            message = cdr.restamped(message, raw.log_time_ns)
        elif received and role == 'joint_states':
            message = _restamped_transforms(message, raw.log_time_ns)
        reduce = _REDUCTIONS.get(role)
        messages[role].append(reduce(message, raw) if reduce else message)
    return messages


def is_transforms(topic: Topic) -> bool:
    """Return whether a topic has transforms of the table instead of its joint."""
    return cdr.full_name(topic.msgtype) == TF_MESSAGE


def states_of_transforms(messages: Sequence[Any], frame: str, joint: str, where: str) -> list[Any]:
    """
    Return the states of the table's joint in tf2_msgs/TFMessage messages.

    frame : child frame that turns with the table
    where : file and topic, for the error
    :raises BagError: no transform is of the frame, or it does not turn about z
    """
    found = [state for message in messages for state in table_states(message, frame, joint, where)]
    if not found:
        known = sorted(set().union(*(child_frames(message) for message in messages)))
        raise BagError(
            f'{where}: no transform has the child frame {frame!r}; child frames there: '
            f'{", ".join(known) or "none"}; name that of the table by --table-frame'
        )
    return found


def _restamped_transforms(message: Any, stamp_ns: int) -> Any:
    transforms = [cdr.restamped(transform, stamp_ns) for transform in message.transforms]
    return replace(message, transforms=transforms)
