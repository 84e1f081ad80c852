# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reads the registered views, their poses and sample images from the bag of a scan."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ivfmc_ros.errors import BagError
from ivfmc_ros.model import Frame
from ivfmc_ros.model import Image
from ivfmc_ros.model import Poses
from ivfmc_ros.model import Profile
from ivfmc_ros.model import View
from ivfmc_ros.storage.bag.reader import Bag
from ivfmc_ros.storage.bag.reader import open_bag
from ivfmc_ros.storage.messages import cdr
from ivfmc_ros.storage.messages.image_decoding import decode_compressed
from ivfmc_ros.storage.messages.image_decoding import decode_image
from ivfmc_ros.storage.messages.point_clouds import to_profile
from ivfmc_ros.storage.messages.point_clouds import to_view
from ivfmc_ros.storage.messages.sensor_messages import COMPRESSED_IMAGE
from ivfmc_ros.storage.messages.sensor_messages import IMAGE
from ivfmc_ros.storage.messages.view_poses import to_poses

# Number of sample images, spread over the scan.
_SAMPLES = 4
# Ends of the names of image topics, with the type of each.
_IMAGE_TOPICS = {'image_raw': IMAGE, 'image_raw/compressed': COMPRESSED_IMAGE}


@dataclass(frozen=True, eq=False, kw_only=True)
class ScanContents:
    """
    Result of a recorded scan.

    views, poses : of the last registration
    samples : a few frames with the stripe points found in them
    """

    views: list[View]
    poses: Poses
    samples: list[tuple[Frame, Profile]]


def scan_contents(folder: Path) -> ScanContents:
    """
    Read the views of a scan, their poses and sample images from its bag.

    folder : folder of the scan
    :raises BagError: the bag is missing or damaged, or has no views or poses
    :raises MessageError: a message lacks a field of its topic
    """
    bag = open_bag(folder)
    views = _views(bag)
    return ScanContents(views=views, poses=_poses(bag, views), samples=_samples(bag))


def registered_views(folder: Path) -> tuple[list[View], Poses]:
    """
    Read the views of a scan and their poses, without images.

    :raises BagError, MessageError: as ``scan_contents``
    """
    bag = open_bag(folder)
    views = _views(bag)
    return views, _poses(bag, views)


def _topic_with_messages(bag: Bag, end: str) -> str | None:
    found = [
        name for name, topic in bag.topics.items() if name.endswith(f'/{end}') and topic.count
    ]
    return found[0] if found else None


def _required_topic(bag: Bag, end: str) -> str:
    name = _topic_with_messages(bag, end)
    if name is None:
        raise BagError(f'{bag.path}: has no messages on {end}; it has {bag.listing()}')
    return name


def _views(bag: Bag) -> list[View]:
    name = _required_topic(bag, 'view')
    decode = bag.decoder(name)
    latest = {}
    for raw in bag.messages([name]):
        view = to_view(decode(raw), f'{bag.path}: {name}')
        latest[view.number] = view
    return [latest[number] for number in sorted(latest)]


def _poses(bag: Bag, views: list[View]) -> Poses:
    name = _required_topic(bag, 'view_poses')
    [*_, last] = map(bag.decoder(name), bag.messages([name]))
    return to_poses(last, views, f'{bag.path}: {name}')


def _samples(bag: Bag) -> list[tuple[Frame, Profile]]:
    """Return images whose profiles have points, spread over the scan."""
    name = _topic_with_messages(bag, 'profile')
    image_topics = [
        (topic, kind)
        for end, kind in _IMAGE_TOPICS.items()
        if (topic := _topic_with_messages(bag, end))
    ]
    if name is None or not image_topics:
        return []
    decode = bag.decoder(name)
    where = f'{bag.path}: {name}'
    profiles = [p for raw in bag.messages([name]) if len(p := to_profile(decode(raw), where))]
    chosen = {p.stamp_ns: p for p in profiles[:: max(1, len(profiles) // _SAMPLES)][:_SAMPLES]}
    topic, kind = image_topics[0]
    return [(_frame(image, p), p) for image, p in _images(bag, topic, kind, chosen)]


def _images(
    bag: Bag, topic: str, kind: str, chosen: Mapping[int, Profile]
) -> list[tuple[Image, Profile]]:
    decode = bag.decoder(topic)
    convert = decode_compressed if kind == COMPRESSED_IMAGE else decode_image
    found = []
    for raw in bag.messages([topic]):
        # the stamp is read without decoding: most images are not needed
        if bag.stamp_ns(raw) in chosen:
            message = decode(raw)
            profile = chosen[cdr.stamp_ns(message)]
            found.append((convert(message, f'{bag.path}: {topic}'), profile))
    return found


def _frame(image: Image, profile: Profile) -> Frame:
    return Frame(
        image=image,
        stamp_ns=profile.stamp_ns,
        angle=profile.angle,
        laser=profile.laser,
        view=profile.view,
        seq=profile.seq,
    )
