# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Finds the topics of a scan in a bag by message type and end of the name, in any namespace."""

from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import dataclass

from ivfmc_ros.errors import BagError
from ivfmc_ros.storage.bag.bag_file import Topic
from ivfmc_ros.storage.bag.reader import Bag
from ivfmc_ros.storage.messages import cdr
from ivfmc_ros.storage.messages.sensor_messages import CAMERA_INFO
from ivfmc_ros.storage.messages.sensor_messages import COMPRESSED_IMAGE
from ivfmc_ros.storage.messages.sensor_messages import IMAGE
from ivfmc_ros.storage.messages.sensor_messages import JOINT_STATE
from ivfmc_ros.storage.messages.sensor_messages import POINT_CLOUD
from ivfmc_ros.storage.messages.sensor_messages import TF_MESSAGE
from ivfmc_ros.validation import require_one_of

# Role of a topic -> ends of its name, with the type of each. Topics of an earlier group are
# preferred: images of image_proc are made of those on image_raw.
_ROLES: dict[str, tuple[dict[str, str], ...]] = {
    'image': (
        {'image_raw': IMAGE, 'image_raw/compressed': COMPRESSED_IMAGE},
        {'image_mono': IMAGE, 'image_mono/compressed': COMPRESSED_IMAGE},
        {'image_color': IMAGE, 'image_color/compressed': COMPRESSED_IMAGE},
    ),
    'camera_info': ({'camera_info': CAMERA_INFO},),
    # transforms of the table, where the joint itself was not recorded
    'joint_states': ({'joint_states': JOINT_STATE}, {'tf': TF_MESSAGE}),
    'laser_states': ({'laser_states': JOINT_STATE},),
    'profile': ({'profile': POINT_CLOUD},),
}
# image_transport publishes an image on its topic and, compressed, below it.
_COMPRESSED = '/compressed'


@dataclass(frozen=True, kw_only=True)
class ScanTopics:
    """
    The topics of a scan, by role; None where the bag has no such topic.

    joint_states : of JointState, or of TFMessage where the bag has only transforms
    profile : profiles that were extracted from the images during the recording
    """

    image: Topic
    joint_states: Topic
    camera_info: Topic | None
    laser_states: Topic | None
    profile: Topic | None = None


def find_scan_topics(bag: Bag, chosen: Mapping[str, str] | None = None) -> ScanTopics:
    """
    Find the topics of a scan.

    chosen : role ('image', 'camera_info', 'joint_states', 'laser_states', 'profile') -> topic,
        as the user chose
    :raises BagError: there are no messages, images or joint states are missing, or several topics
        fit a role
    """
    chosen = chosen or {}
    for role in chosen:
        require_one_of(f'{bag.path}: topic', role, _ROLES, error=BagError)
    if not bag.message_count:
        raise BagError(f'{bag.path}: has no messages; it has {bag.listing()}')
    image = _required(bag, 'image', chosen)
    return ScanTopics(
        image=image,
        joint_states=_required(bag, 'joint_states', chosen),
        camera_info=_find(bag, 'camera_info', chosen, beside=image.name),
        laser_states=_find(bag, 'laser_states', chosen),
        profile=_find(bag, 'profile', chosen),
    )


def missing_topic_error(bag: Bag, role: str) -> BagError:
    """Return the error that names the missing topic and the existing ones."""
    expected = ' or '.join(f'{end} ({msgtype})' for end, msgtype in _ROLES[role][0].items())
    return BagError(
        f'{bag.path}: has no topic {expected}; it has {bag.listing()}; another name can be given '
        f'by --role {role}=TOPIC'
    )


def _required(bag: Bag, role: str, chosen: Mapping[str, str]) -> Topic:
    topic = _find(bag, role, chosen)
    if topic is None:
        raise missing_topic_error(bag, role)
    return topic


def _find(bag: Bag, role: str, chosen: Mapping[str, str], beside: str = '') -> Topic | None:
    """Return the topic of a role or None; of several the one in the namespace of ``beside``."""
    if role in chosen:
        return _chosen_topic(bag, role, chosen[role])
    for ends in _ROLES[role]:
        found = [
            topic
            for topic in bag.topics.values()
            for end, msgtype in ends.items()
            if _fits(topic, end, msgtype)
        ]
        found = _without_copies(found)
        if beside and len(found) > 1:
            found = [topic for topic in found if _namespace(topic.name) == _namespace(beside)]
        if len(found) > 1:
            names = ' and '.join(sorted(topic.name for topic in found))
            raise BagError(
                f'{bag.path}: {names} could each be the {role} topic; choose one by '
                f'--role {role}={min(topic.name for topic in found)}'
            )
        if found:
            return found[0]
    return None


def _without_copies(found: Sequence[Topic]) -> list[Topic]:
    """Return the topics; of an image that was recorded twice, the topic with more of them."""
    by_name = {topic.name: topic for topic in found}
    kept = []
    for topic in found:
        plain = by_name.get(topic.name.removesuffix(_COMPRESSED))
        packed = by_name.get(topic.name.removesuffix(_COMPRESSED) + _COMPRESSED)
        copies = [copy for copy in (plain, packed) if copy is not None]
        if topic is max(copies, key=_count):
            kept.append(topic)
    return kept


def _count(topic: Topic) -> int:
    return topic.count


def _namespace(name: str) -> str:
    """Return the part of an image's or camera_info's name that is the camera's."""
    return name.removesuffix(_COMPRESSED).rpartition('/')[0]


def _fits(topic: Topic, end: str, msgtype: str) -> bool:
    # a topic without messages is ignored; one without a type is refused when it is decoded
    has_name = f'/{topic.name}'.endswith(f'/{end}')
    return bool(topic.count) and has_name and (not topic.msgtype or _has_type(topic, msgtype))


def _chosen_topic(bag: Bag, role: str, name: str) -> Topic:
    topic = bag.topic(name)
    types = {msgtype for ends in _ROLES[role] for msgtype in ends.values()}
    if not any(_has_type(topic, msgtype) for msgtype in types):
        expected = ' or '.join(sorted(types))
        raise BagError(f'{bag.path}: {name}: is {topic.msgtype}, as {role} it must be {expected}')
    if not topic.count:
        raise BagError(f'{bag.path}: {name}: has no messages')
    return topic


def _has_type(topic: Topic, msgtype: str) -> bool:
    return cdr.full_name(topic.msgtype) == msgtype
