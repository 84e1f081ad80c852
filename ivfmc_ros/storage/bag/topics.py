# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Finds the topics of a scan in a bag by message type and end of the name, in any namespace.

Of several that fit, the one in the namespace of the image is taken. Without a topic of the usual
name, the only one of the type is taken, and it is said.
"""

from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import takewhile

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
# Roles for which the only topic of a type is taken, whatever its name; with laser_states and
# profile a wrong one would do harm.
_BY_TYPE = ('image', 'camera_info', 'joint_states')
# Names of topics of these types that have another meaning.
_OTHERS = ('laser_states', 'stripe_image', 'stripe_image/compressed')


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
    Find the topics of a scan; ``type_remarks`` says which were found by their type alone.

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
        joint_states=_required(bag, 'joint_states', chosen, beside=image.name),
        camera_info=_find(bag, 'camera_info', chosen, beside=image.name),
        laser_states=_find(bag, 'laser_states', chosen, beside=image.name),
        profile=_find(bag, 'profile', chosen, beside=image.name),
    )


def type_remarks(
    bag: Bag, topics: ScanTopics, chosen: Mapping[str, str] | None = None
) -> list[str]:
    """Return a remark for each topic that was neither chosen nor found by its name."""
    remarks = []
    for role in _BY_TYPE:
        topic = getattr(topics, role)
        if topic is None or role in (chosen or {}):
            continue
        ends = [(end, kind) for group in _ROLES[role] for end, kind in group.items()]
        if not any(_fits(topic, end, kind) for end, kind in ends):
            remarks.append(
                f'{bag.path}: {topic.name} is read as {role}: it is the only topic of its type; '
                f'another one can be chosen by --role {role}=TOPIC'
            )
    return remarks


def missing_topic_error(bag: Bag, role: str) -> BagError:
    """Return the error that names the missing topic and the existing ones."""
    expected = ' or '.join(f'{end} ({msgtype})' for end, msgtype in _ROLES[role][0].items())
    return BagError(
        f'{bag.path}: has no topic {expected}; it has {bag.listing()}; another name can be given '
        f'by --role {role}=TOPIC'
    )


def _required(bag: Bag, role: str, chosen: Mapping[str, str], beside: str = '') -> Topic:
    topic = _find(bag, role, chosen, beside)
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
            found = _beside(found, role, beside)
        _require_one(bag, role, found)
        if found:
            return found[0]
    return _find_by_type(bag, role, beside) if role in _BY_TYPE else None


def _find_by_type(bag: Bag, role: str, beside: str) -> Topic | None:
    """Return the only topic of the type of a role; None where there is none."""
    types = set(_ROLES[role][0].values())
    found = [
        topic
        for topic in bag.topics.values()
        if topic.count
        and cdr.full_name(topic.msgtype) in types
        and not any(f'/{topic.name}'.endswith(f'/{end}') for end in _OTHERS)
    ]
    found = _without_copies(found)
    if role == 'camera_info':
        # that of another camera would be wrong
        found = _beside(found, role, beside)
        return found[0] if len(found) == 1 else None
    _require_one(bag, role, found)
    return found[0] if found else None


def _require_one(bag: Bag, role: str, found: Sequence[Topic]) -> None:
    """:raises BagError: several topics fit a role."""
    if len(found) > 1:
        names = ' and '.join(sorted(topic.name for topic in found))
        raise BagError(
            f'{bag.path}: {names} could each be the {role} topic; choose one by '
            f'--role {role}={min(topic.name for topic in found)}'
        )


def _beside(found: list[Topic], role: str, image: str) -> list[Topic]:
    """Return the topics of the image's camera, or those with most of the image's namespace."""
    if role == 'camera_info':
        return [topic for topic in found if _namespace(topic.name) == _namespace(image)]
    shared = [_shared_parts(topic.name, image) for topic in found]
    if not max(shared):
        return found
    return [topic for topic, count in zip(found, shared, strict=True) if count == max(shared)]


def _shared_parts(name: str, image: str) -> int:
    """Return the number of namespaces that a topic has in common with an image."""
    pairs = zip(name.split('/')[1:-1], _namespace(image).split('/')[1:], strict=False)
    return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], pairs))


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
