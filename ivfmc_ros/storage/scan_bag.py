# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A bag as a scan: pictures with the table angle and the laser that belong to each."""

from collections import Counter
from collections.abc import Callable
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
from ivfmc_ros.errors import CellError
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import MessageError
from ivfmc_ros.model import Frame
from ivfmc_ros.model import Image
from ivfmc_ros.model import Ints
from ivfmc_ros.storage.bag.reader import Bag
from ivfmc_ros.storage.bag.reader import open_bag
from ivfmc_ros.storage.bag.reader import Raw
from ivfmc_ros.storage.bag.topics import find_roles
from ivfmc_ros.storage.bag.topics import missing
from ivfmc_ros.storage.bag.topics import Roles
from ivfmc_ros.storage.frame_matching import Matcher
from ivfmc_ros.storage.frame_matching import MatchSettings
from ivfmc_ros.storage.messages import cdr
from ivfmc_ros.storage.messages.build import COMPRESSED_IMAGE
from ivfmc_ros.storage.messages.camera_info import camera_of
from ivfmc_ros.storage.messages.image_decoding import decode_compressed
from ivfmc_ros.storage.messages.image_decoding import decode_image
from ivfmc_ros.storage.messages.profile_head import ProfileHead
from ivfmc_ros.storage.messages.profile_head import read_head
from ivfmc_ros.storage.reports import joint_of
from ivfmc_ros.storage.tracks import JointTrack
from ivfmc_ros.storage.tracks import LaserTrack


@dataclass(frozen=True, kw_only=True)
class _Shot:
    """
    What belongs to one picture.

    reason : why it is not used; empty if it is
    dark_ns : stamp of the picture with all lasers off that goes with it
    """

    stamp_ns: int
    angle: float
    reason: str = ''
    laser: int = 0
    view: int = 0
    speed: float = 0.0
    dark_ns: int | None = None


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
        return sum(not shot.reason for shot in self.shots)

    def frames(self) -> Iterator[Frame]:
        """
        Yield the frames in the order of their stamps; each picture is decoded when it comes.

        :raises FileError: a picture is cut off or cannot be decoded
        :raises CellError: a picture has another size than the camera
        """
        decode = self.bag.decoder(self.roles.image.name)
        seq = 0
        wanted = {shot.dark_ns for shot in self.shots if not shot.reason}
        dark: dict[int | None, Image] = {}
        for (raw, message), shot in zip(self._in_order(decode), self.shots, strict=True):
            if shot.stamp_ns in wanted:
                # those of stands before are not needed any more
                dark = {shot.stamp_ns: self._picture(raw, message)}
            if shot.reason:
                continue
            yield Frame(
                image=self._picture(raw, message),
                stamp_ns=shot.stamp_ns,
                angle=shot.angle,
                laser=shot.laser,
                view=shot.view,
                seq=seq,
                speed=shot.speed,
                dark=dark.get(shot.dark_ns),
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
    dark: bool = False,
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
    matching : which pictures become profiles; None: those that did when they were recorded, in
        the same views, if the bag has the profiles
    dark : give each frame the picture with all lasers off at the same stand of the table
    salvage : use what can be read of a damaged bag
    :raises BagError: the bag is damaged, lacks a topic, or does not tell the table's angle at the
        stamp of a picture
    """
    bag = open_bag(path, salvage=salvage)
    roles = find_roles(bag, topics)
    messages = _read(bag, roles)
    stamps = np.sort(np.array(messages['image'], dtype=np.int64))
    if not salvage:
        where = f'{path}: {roles.joint_states.name}'
        _require_angles(JointTrack.of(messages['joint_states'], joint, where), stamps, where)
    given = matching or MatchSettings(dark=dark)
    shots = _match(bag, roles, messages, joint, lasers, stamps, given)
    heads = {head.stamp_ns: head for head in messages['profile'] if head is not None}
    if heads and matching is None:
        shots = [_as_recorded(shot, heads.get(shot.stamp_ns)) for shot in shots]
    skipped = Counter(shot.reason for shot in shots if shot.reason)
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


def _head(message: Any) -> ProfileHead | None:
    try:
        return read_head(message)
    except MessageError:
        # somebody else's clouds of that name
        return None


# what is kept of the messages of a role
_REDUCED: Mapping[str, Callable[[Any], Any]] = {'image': cdr.stamp_ns, 'profile': _head}


def recorded_profiles(bag: Bag, topic: str) -> dict[int, ProfileHead]:
    """Return what pictures became when they were recorded, by stamp; none of foreign clouds."""
    decode = bag.decoder(topic)
    heads = (_head(decode(raw)) for raw in bag.messages([topic]))
    return {head.stamp_ns: head for head in heads if head is not None}


def _read(bag: Bag, roles: Roles) -> dict[str, list[Any]]:
    """Return all messages by role; of pictures the stamps, of profiles the heads."""
    named = {role: topic.name for role, topic in vars(roles).items() if topic is not None}
    decoders = {name: bag.decoder(name) for name in named.values()}
    role_of = {name: role for role, name in named.items()}
    messages: dict[str, list[Any]] = {role: [] for role in vars(roles)}
    for raw in bag.messages(role_of.keys()):
        role = role_of[raw.topic]
        if role == 'camera_info' and messages[role]:
            continue
        message = decoders[raw.topic](raw)
        reduce = _REDUCED.get(role)
        messages[role].append(reduce(message) if reduce else message)
    return messages


def _match(
    bag: Bag,
    roles: Roles,
    messages: Mapping[str, list[Any]],
    joint: str,
    lasers: Sequence[str],
    stamps: Ints,
    settings: MatchSettings,
) -> list[_Shot]:
    """Return for each stamp what belongs to the picture."""
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
    return [
        _Shot(
            stamp_ns=match.stamp_ns,
            angle=match.angle,
            reason=match.reason,
            laser=match.laser,
            view=match.view,
            speed=match.speed,
            dark_ns=match.dark.stamp_ns if match.dark else None,
        )
        for match in matcher.ready()
    ]


def _require_angles(track: JointTrack, stamps: Ints, where: str) -> None:
    known = track.covers(stamps)
    if not known.all():
        at = _text(int(stamps[np.argmin(known)]))
        raise BagError(
            f'{where}: {np.count_nonzero(~known)} pictures are outside the reported positions, '
            f'the first at {at}; record joint_states from before the first picture to the last'
        )


def _as_recorded(shot: _Shot, head: ProfileHead | None) -> _Shot:
    """
    Take a picture as the profile that it became when it was recorded, if it became one.

    Which of several sweeps is which view is known to who took them, and to nobody else.
    """
    if head is None:
        return replace(shot, reason=shot.reason or 'no profile when recorded')
    return replace(
        shot, reason='', angle=head.angle, laser=head.laser, view=head.view, speed=head.speed
    )


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
    try:
        return camera_of(messages['camera_info'][0], f'{bag.path}: {roles.camera_info.name}')
    except CellError as error:
        raise BagError(str(error)) from error


def _text(stamp_ns: int) -> str:
    seconds, nanoseconds = divmod(stamp_ns, cdr.NANOSECONDS)
    return f'{seconds}.{nanoseconds:09d} s'
