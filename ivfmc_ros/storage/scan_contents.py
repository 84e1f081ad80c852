# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a recorded scan holds of its own result: its views, where they belong, some pictures."""

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
from ivfmc_ros.storage.messages.build import COMPRESSED_IMAGE
from ivfmc_ros.storage.messages.build import IMAGE
from ivfmc_ros.storage.messages.image_decoding import decode_compressed
from ivfmc_ros.storage.messages.image_decoding import decode_image
from ivfmc_ros.storage.messages.point_clouds import to_profile
from ivfmc_ros.storage.messages.point_clouds import to_view
from ivfmc_ros.storage.messages.view_poses import to_poses

_SAMPLES = 4
_PICTURES = {'image_raw': IMAGE, 'image_raw/compressed': COMPRESSED_IMAGE}


@dataclass(frozen=True, eq=False, kw_only=True)
class ScanContents:
    """
    A scan as it was recorded to the end.

    views, poses : as the last registration left them
    samples : a few pictures with the points found in them
    """

    views: list[View]
    poses: Poses
    samples: list[tuple[Frame, Profile]]


def scan_contents(folder: Path) -> ScanContents:
    """
    Read the views of a scan, their poses and some pictures out of its bag.

    :raises BagError: the bag is missing or damaged, or the scan was not registered
    :raises MessageError: a message is not what its topic should hold
    """
    bag = open_bag(folder)
    views = _views(bag)
    return ScanContents(views=views, poses=_poses(bag, views), samples=_samples(bag))


def _named(bag: Bag, end: str) -> str | None:
    found = [
        name for name, topic in bag.topics.items() if name.endswith(f'/{end}') and topic.count
    ]
    return found[0] if found else None


def _required(bag: Bag, end: str) -> str:
    name = _named(bag, end)
    if name is None:
        raise BagError(f'{bag.path}: has no messages on {end}; it has {bag.listing()}')
    return name


def _views(bag: Bag) -> list[View]:
    name = _required(bag, 'view')
    decode = bag.decoder(name)
    latest = {}
    for raw in bag.messages([name]):
        view = to_view(decode(raw), f'{bag.path}: {name}')
        latest[view.number] = view
    return [latest[number] for number in sorted(latest)]


def _poses(bag: Bag, views: list[View]) -> Poses:
    name = _required(bag, 'view_poses')
    [*_, last] = map(bag.decoder(name), bag.messages([name]))
    return to_poses(last, views, f'{bag.path}: {name}')


def _samples(bag: Bag) -> list[tuple[Frame, Profile]]:
    """Return some pictures that became profiles with points, spread over the scan."""
    name = _named(bag, 'profile')
    pictures = {topic: kind for end, kind in _PICTURES.items() if (topic := _named(bag, end))}
    if name is None or not pictures:
        return []
    decode = bag.decoder(name)
    where = f'{bag.path}: {name}'
    profiles = [p for raw in bag.messages([name]) if len(p := to_profile(decode(raw), where))]
    chosen = {p.stamp_ns: p for p in profiles[:: max(1, len(profiles) // _SAMPLES)][:_SAMPLES]}
    topic, kind = next(iter(pictures.items()))
    return [(_frame(image, p), p) for image, p in _pictures(bag, topic, kind, chosen)]


def _pictures(
    bag: Bag, topic: str, kind: str, chosen: Mapping[int, Profile]
) -> list[tuple[Image, Profile]]:
    decode = bag.decoder(topic)
    convert = decode_compressed if kind == COMPRESSED_IMAGE else decode_image
    found = []
    for raw in bag.messages([topic]):
        # a header begins with its stamp, so that most pictures need not be decoded
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
