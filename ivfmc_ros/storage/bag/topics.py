# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which topic of a bag plays which part: by type and last name, in any namespace."""

from collections.abc import Mapping
from dataclasses import dataclass

from ivfmc_ros.errors import BagError
from ivfmc_ros.storage.bag.reader import Bag
from ivfmc_ros.storage.bag.reader import Topic
from ivfmc_ros.storage.messages import cdr
from ivfmc_ros.storage.messages.sensor_messages import CAMERA_INFO
from ivfmc_ros.storage.messages.sensor_messages import COMPRESSED_IMAGE
from ivfmc_ros.storage.messages.sensor_messages import IMAGE
from ivfmc_ros.storage.messages.sensor_messages import JOINT_STATE
from ivfmc_ros.storage.messages.sensor_messages import POINT_CLOUD
from ivfmc_ros.validation import require_one_of

# role -> the ends of a name and the type that goes with each
_ROLES = {
    'image': {'image_raw': IMAGE, 'image_raw/compressed': COMPRESSED_IMAGE},
    'camera_info': {'camera_info': CAMERA_INFO},
    'joint_states': {'joint_states': JOINT_STATE},
    'laser_states': {'laser_states': JOINT_STATE},
    'profile': {'profile': POINT_CLOUD},
}


@dataclass(frozen=True, kw_only=True)
class ScanTopics:
    """
    The topics of a scan; None where the bag has none.

    profile : what was made of the pictures when they were recorded
    """

    image: Topic
    joint_states: Topic
    camera_info: Topic | None
    laser_states: Topic | None
    profile: Topic | None = None


def find_scan_topics(bag: Bag, named: Mapping[str, str] | None = None) -> ScanTopics:
    """
    Find the topics of a scan.

    named : role ('image', 'camera_info', 'joint_states', 'laser_states', 'profile') -> topic,
        where the user has chosen
    :raises BagError: pictures or joint states are missing, or several topics could be meant
    """
    named = named or {}
    for role in named:
        require_one_of(f'{bag.path}: topic', role, _ROLES, error=BagError)
    return ScanTopics(
        image=_required(bag, 'image', named),
        joint_states=_required(bag, 'joint_states', named),
        camera_info=_find(bag, 'camera_info', named),
        laser_states=_find(bag, 'laser_states', named),
        profile=_find(bag, 'profile', named),
    )


def missing(bag: Bag, role: str) -> BagError:
    """Return the error that says which topic a bag lacks and what it has."""
    wanted = ' or '.join(f'{end} ({msgtype})' for end, msgtype in _ROLES[role].items())
    return BagError(f'{bag.path}: has no topic {wanted}; it has {bag.listing()}')


def _required(bag: Bag, role: str, named: Mapping[str, str]) -> Topic:
    topic = _find(bag, role, named)
    if topic is None:
        raise missing(bag, role)
    return topic


def _find(bag: Bag, role: str, named: Mapping[str, str]) -> Topic | None:
    if role in named:
        return _chosen(bag, role, named[role])
    found = [
        topic
        for topic in bag.topics.values()
        for end, msgtype in _ROLES[role].items()
        if _fits(topic, end, msgtype)
    ]
    if len(found) > 1:
        names = ' and '.join(sorted(topic.name for topic in found))
        raise BagError(f'{bag.path}: {names} could each be the {role} topic; say which it is')
    return found[0] if found else None


def _fits(topic: Topic, end: str, msgtype: str) -> bool:
    # a topic that nobody published on is none; one without a type is refused when it is decoded
    named = f'/{topic.name}'.endswith(f'/{end}')
    return bool(topic.count) and named and (not topic.msgtype or _is(topic, msgtype))


def _chosen(bag: Bag, role: str, name: str) -> Topic:
    topic = bag.topic(name)
    types = set(_ROLES[role].values())
    if not any(_is(topic, msgtype) for msgtype in types):
        wanted = ' or '.join(sorted(types))
        raise BagError(f'{bag.path}: {name}: is {topic.msgtype}, as {role} it must be {wanted}')
    if not topic.count:
        raise BagError(f'{bag.path}: {name}: has no messages')
    return topic


def _is(topic: Topic, msgtype: str) -> bool:
    return cdr.full_name(topic.msgtype) == msgtype
