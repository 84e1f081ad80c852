# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reads a bag as a scan: frames, which are images with their table angle, laser and view."""

from collections import Counter
from collections.abc import Iterator
from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace
import heapq
from pathlib import Path
from statistics import median
from typing import Any

from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.errors import BagError
from ivfmc_ros.errors import CellError
from ivfmc_ros.errors import FileError
from ivfmc_ros.model import Frame
from ivfmc_ros.model import Image
from ivfmc_ros.storage.bag.bag_file import RawMessage
from ivfmc_ros.storage.bag.reader import Bag
from ivfmc_ros.storage.bag.reader import open_bag
from ivfmc_ros.storage.bag.topics import find_scan_topics
from ivfmc_ros.storage.bag.topics import missing_topic_error
from ivfmc_ros.storage.bag.topics import ScanTopics
from ivfmc_ros.storage.bag.topics import type_remarks
from ivfmc_ros.storage.matching.clock_offset import clock_text
from ivfmc_ros.storage.matching.clock_offset import clocks_differ
from ivfmc_ros.storage.matching.frame_matching import FrameMatch
from ivfmc_ros.storage.matching.frame_matching import FrameMatcher
from ivfmc_ros.storage.matching.frame_matching import MatchSettings
from ivfmc_ros.storage.matching.joint_history import JointHistory
from ivfmc_ros.storage.matching.laser_history import LaserHistory
from ivfmc_ros.storage.messages import cdr
from ivfmc_ros.storage.messages.camera_info import distortion_remark
from ivfmc_ros.storage.messages.camera_info import to_camera
from ivfmc_ros.storage.messages.image_decoding import decode_compressed
from ivfmc_ros.storage.messages.image_decoding import decode_image
from ivfmc_ros.storage.messages.profile_header import ProfileHeader
from ivfmc_ros.storage.messages.rectified import require_raw_images
from ivfmc_ros.storage.messages.sensor_messages import COMPRESSED_IMAGE
from ivfmc_ros.storage.scans.scan_messages import is_transforms
from ivfmc_ros.storage.scans.scan_messages import read_messages
from ivfmc_ros.storage.scans.scan_messages import received_remarks
from ivfmc_ros.storage.scans.scan_messages import states_of_transforms


@dataclass(frozen=True, kw_only=True)
class ScanBag:
    """
    A scan in a bag; all of it has been read and checked except the images.

    camera : calibration of the camera that took the images
    skipped : number of images that are not used, by reason
    damage : description of the damage of a bag that was opened for salvage, or None
    matches : one for each image, by stamp
    remarks : what was missing, damaged or contradictory and did not prevent reading
    received : the stamps are the times at which the messages were recorded
    """

    path: Path
    camera: Camera
    skipped: Mapping[str, int]
    damage: str | None
    bag: Bag
    topics: ScanTopics
    matches: tuple[FrameMatch, ...]
    remarks: tuple[str, ...] = ()
    received: bool = False

    @property
    def frame_count(self) -> int:
        """Number of frames."""
        return sum(not match.reason for match in self.matches)

    def frames(self) -> Iterator[Frame]:
        """
        Yield the frames by stamp; each image is decoded when its frame is yielded.

        :raises FileError: an image is cut off or cannot be decoded
        :raises CellError: an image has another size than the camera
        """
        decode = self.bag.decoder(self.topics.image.name)
        seq = 0
        dark_stamps = {_dark_stamp_ns(match) for match in self.matches if not match.reason}
        dark: dict[int | None, Image] = {}
        bracket_stamps = {other.stamp_ns for match in self.matches for other in match.bracket}
        bracket: dict[int, Image] = {}
        for (raw, message), match in zip(self._by_stamp(decode), self.matches, strict=True):
            if match.stamp_ns in dark_stamps:
                # dark frames of earlier positions are not needed any more
                dark = {match.stamp_ns: self._decode_image(raw, message)}
            if match.stamp_ns in bracket_stamps:
                bracket[match.stamp_ns] = self._decode_image(raw, message)
            if match.reason:
                continue
            yield Frame(
                image=self._decode_image(raw, message),
                stamp_ns=match.stamp_ns,
                angle=match.angle,
                laser=match.laser,
                view=match.view,
                seq=seq,
                speed=match.speed,
                dark=dark.get(_dark_stamp_ns(match)),
                bracket=tuple(bracket.pop(other.stamp_ns) for other in match.bracket),
            )
            seq += 1

    def _decode_image(self, raw: RawMessage, message: Any) -> Image:
        stamp = _stamp_text(cdr.stamp_ns(message))
        where = f'{self.path}: {raw.topic}, image {raw.index} at {stamp}'
        is_compressed = cdr.full_name(self.topics.image.msgtype) == COMPRESSED_IMAGE
        try:
            image = (decode_compressed if is_compressed else decode_image)(message, where)
        except FileError as error:
            raise BagError(str(error)) from error
        self.camera.require_image_size(image.shape, where)
        return image

    def _by_stamp(self, decode: Any) -> Iterator[tuple[RawMessage, Any]]:
        """Yield the image messages by stamp; only those out of order are held in memory."""
        stamps = iter([match.stamp_ns for match in self.matches])
        following = next(stamps, None)
        waiting: list[tuple[int, int, RawMessage, Any]] = []
        name = self.topics.image.name
        # open_scan has read all messages, and has checked their CRCs
        for raw in self.bag.messages([name], validate_crcs=False):
            message = decode(raw)
            stamp_ns = raw.log_time_ns if self.received else cdr.stamp_ns(message)
            heapq.heappush(waiting, (stamp_ns, raw.index, raw, message))
            while waiting and waiting[0][0] == following:
                yield heapq.heappop(waiting)[2:]
                following = next(stamps, None)


def open_scan(  # noqa: PLR0913 - one argument for each thing that a foreign bag may lack
    path: Path,
    *,
    joint: str = 'turntable_joint',
    lasers: Sequence[str] = ('laser',),
    camera: Camera | None = None,
    topics: Mapping[str, str] | None = None,
    matching: MatchSettings | None = None,
    taken: MatchSettings | None = None,
    salvage: bool = False,
    received: bool = False,
    table_frame: str = 'turntable',
) -> ScanBag:
    """
    Open a bag as a scan. The whole bag is read once, so damage is found before any processing.

    path : bag folder or file
    joint : name of the table's joint in joint_states
    lasers : names, in the order of the cell; without laser_states exactly one, always on
    camera : replaces the one in camera_info
    topics : role ('image', 'camera_info', 'joint_states', 'laser_states') -> topic, where it
        is not found by its name or its type, or several topics fit
    matching : which images become frames; None: those that became profiles in the recording, in
        the same views, where the bag has profiles
    taken : how the images were taken (dark frames, several exposures), without ``matching``
    salvage : accept a damaged bag
    received : use the times of recording for the stamps, and no profiles of the recording
    table_frame : child frame of the transforms of the table, where there are no joint_states
    :raises BagError: the bag is damaged, lacks a topic, or has no table angle at the stamp of an
        image
    :raises CellError: the images are rectified, and the camera has the distortion of the raw ones
    """
    bag = open_bag(path, salvage=salvage)
    scan_topics = find_scan_topics(bag, topics)
    messages = read_messages(bag, scan_topics, received=received)
    stamps = _image_stamps(messages, f'{path}: {scan_topics.image.name}')
    where = f'{path}: {scan_topics.joint_states.name}'
    joint_history = _joint_history(messages, scan_topics, joint, table_frame, where)
    ahead_s = 0.0 if received else _clock_offset_s(messages)
    _require_angles(joint_history, [] if salvage else stamps, where, ahead_s)
    always_on = scan_topics.laser_states is None
    settings = replace(matching or taken or MatchSettings(), always_on=always_on)
    laser_history = _laser_history(bag, scan_topics, messages, lasers)
    matches = _match(lasers, settings, (joint_history, laser_history), stamps)
    if matching is None and not received:
        matches = _as_recorded_profiles(matches, messages['profile'])
    said = _recording_remarks(bag, scan_topics, messages, camera, topics)
    table_remarks = _table_remarks(joint_history.remarks(joint), ahead_s, where)
    return ScanBag(
        path=path,
        camera=_camera(bag, scan_topics, messages, camera),
        skipped=_count_skipped(matches, f'{path}: {scan_topics.image.name}'),
        damage=bag.damage,
        bag=bag,
        topics=scan_topics,
        matches=tuple(matches),
        remarks=(*said, *table_remarks, *received_remarks(path, received=received)),
        received=received,
    )


def _joint_history(
    messages: Mapping[str, list[Any]], topics: ScanTopics, joint: str, frame: str, where: str
) -> JointHistory:
    positions = [message for message, _ in messages['joint_states']]
    if is_transforms(topics.joint_states):
        positions = states_of_transforms(positions, frame, joint, where)
    return JointHistory.from_messages(positions, joint, where)


def _match(
    lasers: Sequence[str],
    settings: MatchSettings,
    histories: tuple[JointHistory, LaserHistory],
    stamps_ns: Sequence[int],
) -> list[FrameMatch]:
    joint_history, laser_history = histories
    matcher = FrameMatcher(
        lasers, settings, joint_history=joint_history, laser_history=laser_history
    )
    for stamp_ns in stamps_ns:
        matcher.add_image(stamp_ns, None)
    return list(matcher.pop_matches())


def _count_skipped(matches: Sequence[FrameMatch], where: str) -> dict[str, int]:
    """Return the number of images that are not used by reason; refuse a scan without any other."""
    skipped = Counter(match.reason for match in matches if match.reason)
    if skipped.total() == len(matches):
        reasons = ', '.join(f'{count} {reason}' for reason, count in skipped.items())
        raise BagError(f'{where}: no image can be used ({reasons})')
    return dict(skipped)


def _clock_offset_s(messages: Mapping[str, list[Any]]) -> float:
    """Return by how much the stamps of images are ahead of those of joint_states, seconds."""
    images = [stamp_ns - time_ns for stamp_ns, time_ns in messages['image']]
    table = [
        cdr.stamp_ns(message) - time_ns
        for message, time_ns in messages['joint_states']
        if hasattr(message, 'header')
    ]
    if not images or not table:
        return 0.0
    return float(median(images) - median(table)) / cdr.NANOSECONDS


def _table_remarks(remarks: Sequence[str], ahead_s: float, where: str) -> list[str]:
    said = [*remarks, clock_text(ahead_s)] if clocks_differ(ahead_s) else remarks
    return [f'{where}: {text}' for text in said]


def _image_stamps(messages: Mapping[str, list[Any]], where: str) -> list[int]:
    """:raises BagError: all images have the same stamp."""
    stamps_ns = sorted(stamp_ns for stamp_ns, _ in messages['image'])
    if len(stamps_ns) > 1 and len(set(stamps_ns)) == 1:
        raise BagError(
            f'{where}: all {len(stamps_ns)} images have the stamp {_stamp_text(stamps_ns[0])}: '
            'the camera driver does not set header.stamp to the time of the exposure'
        )
    return stamps_ns


def _require_angles(
    history: JointHistory, stamps_ns: Sequence[int], where: str, ahead_s: float
) -> None:
    outside = [stamp for stamp in stamps_ns if not history.covers(stamp)]
    if not outside:
        return
    if len(outside) == len(stamps_ns) and not clocks_differ(ahead_s):
        # a recorder that logs at the stamps hides the offset
        ahead_s = (stamps_ns[0] - history.stamps_ns[0]) / cdr.NANOSECONDS
    if clocks_differ(ahead_s):
        raise BagError(f'{where}: {clock_text(ahead_s)} and record again')
    raise BagError(
        f'{where}: {len(outside)} images are outside the reported positions, the first at '
        f'{_stamp_text(outside[0])}; record joint_states from before the first image to the '
        'last'
    )


def _as_recorded_profiles(
    matches: list[FrameMatch], profiles: Sequence[ProfileHeader | None]
) -> list[FrameMatch]:
    headers = {header.stamp_ns: header for header in profiles if header is not None}
    if not headers:
        return matches
    return [_as_recorded(match, headers.get(match.stamp_ns)) for match in matches]


def _as_recorded(match: FrameMatch, header: ProfileHeader | None) -> FrameMatch:
    """
    Return the match with angle, laser and view of the profile that was recorded of the image.

    The view numbers of several sweeps are in the recorded profiles only.
    """
    if header is None:
        return replace(match, reason=match.reason or 'no profile when recorded')
    return replace(
        match,
        reason='',
        angle=header.angle,
        laser=header.laser,
        view=header.view,
        speed=header.speed,
    )


def _laser_history(
    bag: Bag, topics: ScanTopics, messages: Mapping[str, list[Any]], lasers: Sequence[str]
) -> LaserHistory:
    if topics.laser_states is not None:
        where = f'{bag.path}: {topics.laser_states.name}'
        return LaserHistory.from_messages(messages['laser_states'], lasers, where)
    if len(lasers) != 1:
        raise BagError(
            f'{missing_topic_error(bag, "laser_states")}; without it the cell must have one '
            f'laser, it has {len(lasers)} ({", ".join(lasers)})'
        )
    return LaserHistory(lasers)


def _camera(
    bag: Bag, topics: ScanTopics, messages: Mapping[str, list[Any]], given: Camera | None
) -> Camera:
    """Return the given camera or that of camera_info, if it fits the images."""
    camera = given or _recorded_camera(bag, topics, messages)
    require_raw_images(topics.image.name, camera)
    return camera


def _recorded_camera(bag: Bag, topics: ScanTopics, messages: Mapping[str, list[Any]]) -> Camera:
    if topics.camera_info is None:
        raise missing_topic_error(bag, 'camera_info')
    try:
        return to_camera(messages['camera_info'][0], f'{bag.path}: {topics.camera_info.name}')
    except CellError as error:
        raise BagError(str(error)) from error


def _recording_remarks(
    bag: Bag,
    topics: ScanTopics,
    messages: Mapping[str, list[Any]],
    given: Camera | None,
    chosen: Mapping[str, str] | None,
) -> tuple[str, ...]:
    """Return the remarks on files and topics, and on the camera where it is the recorded one."""
    remarks = (*bag.remarks, *type_remarks(bag, topics, chosen))
    if given is not None or topics.camera_info is None:
        return remarks
    text = distortion_remark(messages['camera_info'][0])
    where = f'{bag.path}: {topics.camera_info.name}'
    return (*remarks, f'{where}: {text}') if text else remarks


def _dark_stamp_ns(match: FrameMatch) -> int | None:
    return match.dark.stamp_ns if match.dark else None


def _stamp_text(stamp_ns: int) -> str:
    seconds, nanoseconds = divmod(stamp_ns, cdr.NANOSECONDS)
    return f'{seconds}.{nanoseconds:09d} s'
