# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A bag as a scan: pictures with the table angle and the laser that belong to each."""

from collections import Counter
from collections.abc import Iterator
from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace
import heapq
import math
from pathlib import Path
from typing import Any

import numpy as np

from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.errors import BagError
from ivfmc_ros.errors import FileError
from ivfmc_ros.model import Frame
from ivfmc_ros.model import Image
from ivfmc_ros.model import Ints
from ivfmc_ros.storage import cdr
from ivfmc_ros.storage.bag_reader import Bag
from ivfmc_ros.storage.bag_reader import open_bag
from ivfmc_ros.storage.bag_reader import Raw
from ivfmc_ros.storage.camera_info import camera_of
from ivfmc_ros.storage.image_decoding import decode_compressed
from ivfmc_ros.storage.image_decoding import decode_image
from ivfmc_ros.storage.matching import Matcher
from ivfmc_ros.storage.matching import MatchSettings
from ivfmc_ros.storage.messages import COMPRESSED_IMAGE
from ivfmc_ros.storage.reports import joint_of
from ivfmc_ros.storage.roles import find_roles
from ivfmc_ros.storage.roles import missing
from ivfmc_ros.storage.roles import Roles
from ivfmc_ros.storage.tracks import JointTrack
from ivfmc_ros.storage.tracks import LaserTrack


@dataclass(frozen=True, kw_only=True)
class _Shot:
    """What belongs to one picture; ``laser`` is None where it is not used."""

    stamp_ns: int
    angle: float
    laser: int | None
    view: int = 0
    speed: float = 0.0


@dataclass(frozen=True, kw_only=True)
class ScanBag:
    """
    A scan in a bag, every part of which has been found and checked except the pictures.

    camera : what took the pictures
    skipped : how many pictures are not used, by reason
    damage : what is wrong with a bag that was opened to salvage what it holds, or None
    """

    path: Path
    camera: Camera
    skipped: Mapping[str, int]
    damage: str | None
    bag: Bag
    roles: Roles
    shots: tuple[_Shot, ...]

    @property
    def frame_count(self) -> int:
        """How many frames there are, for progress."""
        return sum(shot.laser is not None for shot in self.shots)

    def frames(self) -> Iterator[Frame]:
        """
        Yield the frames in the order of their stamps; each picture is decoded when it comes.

        :raises FileError: a picture is cut off or cannot be decoded
        :raises CellError: a picture has another size than the camera
        """
        decode = self.bag.decoder(self.roles.image.name)
        seq = 0
        for (raw, message), shot in zip(self._in_order(decode), self.shots, strict=True):
            if shot.laser is None:
                continue
            yield Frame(
                image=self._picture(raw, message),
                stamp_ns=shot.stamp_ns,
                angle=shot.angle,
                laser=shot.laser,
                view=shot.view,
                seq=seq,
                speed=shot.speed,
            )
            seq += 1

    def _picture(self, raw: Raw, message: Any) -> Image:
        where = f'{self.path}: {raw.topic}, picture {raw.index} at {_text(cdr.stamp_ns(message))}'
        compressed = cdr.full_name(self.roles.image.msgtype) == COMPRESSED_IMAGE
        try:
            image = (decode_compressed if compressed else decode_image)(message, where)
        except FileError as error:
            raise BagError(str(error)) from error
        self.camera.require_image(image.shape, where)
        return image

    def _in_order(self, decode: Any) -> Iterator[tuple[Raw, Any]]:
        """Yield the image messages by stamp; only those out of order wait in memory."""
        stamps = iter([shot.stamp_ns for shot in self.shots])
        following = next(stamps, None)
        waiting: list[tuple[int, int, Raw, Any]] = []
        for raw in self.bag.messages([self.roles.image.name]):
            message = decode(raw)
            heapq.heappush(waiting, (cdr.stamp_ns(message), raw.index, raw, message))
            while waiting and waiting[0][0] == following:
                yield heapq.heappop(waiting)[2:]
                following = next(stamps, None)


def read_scan(
    path: Path,
    *,
    joint: str = 'turntable_joint',
    lasers: Sequence[str] = ('laser',),
    camera: Camera | None = None,
    topics: Mapping[str, str] | None = None,
    matching: MatchSettings | None = None,
    salvage: bool = False,
) -> ScanBag:
    """
    Open a bag as a scan. Its whole length is read once, so that damage shows before the work.

    joint : the table's, in joint_states
    lasers : their names in the order of the cell; a bag without laser_states needs exactly one,
        which then was always on
    camera : instead of the one in camera_info
    topics : role ('image', 'camera_info', 'joint_states', 'laser_states') -> topic, where it
        cannot be found by its name or several could be meant
    matching : which pictures become profiles
    salvage : use what can be read of a damaged bag
    :raises BagError: the bag is damaged, lacks a topic, or does not tell the table's angle at the
        stamp of a picture
    """
    bag = open_bag(path, salvage=salvage)
    roles = find_roles(bag, topics)
    messages = _read(bag, roles)
    stamps = np.sort(np.array(messages['image'], dtype=np.int64))
    where = f'{path}: {roles.joint_states.name}'
    track = JointTrack.of(messages['joint_states'], joint, where)
    known = track.covers(stamps)
    if not known.all() and not salvage:
        at = _text(int(stamps[np.argmin(known)]))
        raise BagError(
            f'{where}: {np.count_nonzero(~known)} pictures are outside the reported positions, '
            f'the first at {at}; record joint_states from before the first picture to the last'
        )
    matching = matching or MatchSettings()
    shots, reasons = _match(bag, roles, messages, joint, lasers, stamps, matching)
    skipped = Counter(reason for reason in reasons if reason)
    if skipped.total() == len(shots):
        listing = ', '.join(f'{count} {reason}' for reason, count in skipped.items())
        raise BagError(f'{path}: {roles.image.name}: no picture can be used ({listing})')
    return ScanBag(
        path=path,
        camera=camera or _camera(bag, roles, messages),
        skipped=dict(skipped),
        damage=bag.damage,
        bag=bag,
        roles=roles,
        shots=tuple(shots),
    )


def _read(bag: Bag, roles: Roles) -> dict[str, list[Any]]:
    """Return all messages by role; of pictures the stamps, of camera_info the first."""
    named = {role: topic.name for role, topic in vars(roles).items() if topic is not None}
    decoders = {name: bag.decoder(name) for name in named.values()}
    role_of = {name: role for role, name in named.items()}
    messages: dict[str, list[Any]] = {role: [] for role in vars(roles)}
    for raw in bag.messages(role_of.keys()):
        role = role_of[raw.topic]
        if role == 'camera_info' and messages[role]:
            continue
        message = decoders[raw.topic](raw)
        messages[role].append(cdr.stamp_ns(message) if role == 'image' else message)
    return messages


def _match(
    bag: Bag,
    roles: Roles,
    messages: Mapping[str, list[Any]],
    joint: str,
    lasers: Sequence[str],
    stamps: Ints,
    settings: MatchSettings,
) -> tuple[list[_Shot], list[str]]:
    """Return for each stamp what belongs to the picture, and why it is not used if it is not."""
    always_on = roles.laser_states is None
    _require_lasers(bag, roles, messages, lasers)
    matcher = Matcher(lasers, replace(settings, always_on=always_on), history_s=math.inf)
    for message in sorted(messages['joint_states'], key=cdr.stamp_ns):
        stated = joint_of(message, joint)
        if stated is not None:
            matcher.table(cdr.stamp_ns(message), *stated)
    for message in sorted(messages['laser_states'], key=cdr.stamp_ns):
        stated_lasers = zip(message.name, message.position, strict=False)
        matcher.lasers(cdr.stamp_ns(message), dict(stated_lasers))
    for stamp in stamps:
        matcher.picture(int(stamp), None)
    matches = list(matcher.ready())
    shots = [
        _Shot(
            stamp_ns=match.stamp_ns,
            angle=match.angle,
            laser=None if match.reason else match.laser,
            view=match.view,
            speed=match.speed,
        )
        for match in matches
    ]
    return shots, [match.reason for match in matches]


def _require_lasers(
    bag: Bag, roles: Roles, messages: Mapping[str, list[Any]], lasers: Sequence[str]
) -> None:
    if roles.laser_states is not None:
        # refuses what names none of the lasers
        LaserTrack.of(messages['laser_states'], lasers, f'{bag.path}: {roles.laser_states.name}')
    elif len(lasers) != 1:
        raise BagError(
            f'{missing(bag, "laser_states")}; without it the cell must have one laser, '
            f'it has {len(lasers)} ({", ".join(lasers)})'
        )


def _camera(bag: Bag, roles: Roles, messages: Mapping[str, list[Any]]) -> Camera:
    if roles.camera_info is None:
        raise missing(bag, 'camera_info')
    return camera_of(messages['camera_info'][0], f'{bag.path}: {roles.camera_info.name}')


def _text(stamp_ns: int) -> str:
    seconds, nanoseconds = divmod(stamp_ns, cdr.NANOSECONDS)
    return f'{seconds}.{nanoseconds:09d} s'
