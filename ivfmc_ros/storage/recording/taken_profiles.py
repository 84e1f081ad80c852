# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Reads the profiles of an interrupted scan from its bag, to go on behind them.

They are those of the whole chunks, which the recorder keeps when it goes on.
"""

from collections.abc import Callable
from dataclasses import dataclass
from dataclasses import field
import fcntl
from pathlib import Path
from typing import Any

from mcap.records import Message

from ivfmc_ros.errors import BagError
from ivfmc_ros.model import Profile
from ivfmc_ros.storage.bag.unfinished_mcap import read_written_part
from ivfmc_ros.storage.bag.unfinished_mcap import WrittenPart
from ivfmc_ros.storage.bag.writer import FILE_NAME
from ivfmc_ros.storage.bag.writer import PART_NAME
from ivfmc_ros.storage.messages import cdr
from ivfmc_ros.storage.messages.point_clouds import to_profile
from ivfmc_ros.storage.messages.profile_header import read_profile_header
from ivfmc_ros.storage.recording.profile_location import ProfileLocation

_PROFILE, _CAMERA_INFO = 'profile', 'camera_info'


@dataclass(kw_only=True)
class TakenProfiles:
    """
    Collects the profiles of a bag; an object is called with each message (``Visit``).

    with_points : keep the profiles themselves, not only their headers
    locations : of the profiles, in the order of the bag
    profiles : with their points, by seq
    info_stamps_ns : stamps of all camera_info, nanoseconds
    """

    with_points: bool = False
    locations: list[ProfileLocation] = field(default_factory=list)
    profiles: dict[int, Profile] = field(default_factory=dict)
    info_stamps_ns: list[int] = field(default_factory=list)
    _decoders: dict[int, Callable[[bytes], Any]] = field(default_factory=dict)
    _topics: dict[int, str] = field(default_factory=dict)

    def __call__(self, written: WrittenPart, offset: int, message: Message) -> None:
        """Add a message of the chunk at ``offset``; those of other topics are ignored."""
        number = message.channel_id
        if number not in self._topics:
            self._learn(written, number)
        name = self._topics[number].rpartition('/')[2]
        if name == _CAMERA_INFO:
            self.info_stamps_ns.append(cdr.leading_stamp_ns(message.data))
        if name != _PROFILE:
            return
        cloud = self._decoders[number](message.data)
        header = read_profile_header(cloud)
        self.locations.append(
            ProfileLocation(
                header=header,
                topic=self._topics[number],
                index=message.sequence,
                log_time_ns=message.log_time,
                chunk_offset=offset,
            )
        )
        if self.with_points:
            self.profiles[header.seq] = to_profile(cloud, self._topics[number])

    def _learn(self, written: WrittenPart, number: int) -> None:
        channel = next(one for one in written.channels if one.id == number)
        self._topics[number] = channel.topic
        if channel.topic.rpartition('/')[2] == _PROFILE:
            schema = next(one for one in written.schemas if one.id == channel.schema_id)
            text = schema.data.decode('utf-8', 'replace')
            self._decoders[number] = cdr.decoder(schema.name, schema.encoding, text)

    def require_complete(self, bag: Path, count: int | None = None) -> int:
        """
        Return the number of profiles, whose seq have to be 0, 1, 2 and so on.

        count : number that is expected
        :raises BagError: they have not
        """
        seqs = [location.header.seq for location in self.locations]
        if sorted(seqs) != list(range(len(seqs))):
            missing = sorted(set(range(max(seqs) + 1)) - set(seqs))
            what = (
                f'profile {missing[0]} is not in it, profile {max(seqs)} is'
                if missing
                else 'it has profiles of the same number'
            )
            raise BagError(f'{bag}: cannot be gone on with: {what}')
        if count is not None and len(seqs) != count:
            raise BagError(f'{bag}: has {len(seqs)} profiles instead of {count}')
        return len(seqs)


def read_taken_profiles(folder: Path, *, with_points: bool = False) -> TakenProfiles:
    """
    Return the profiles that the bag of an interrupted scan keeps.

    folder : of the scan
    :raises BagError: there is no bag, it is damaged before its last whole chunk, or a profile is
        missing or twice
    :raises MessageError: a message on ``profile`` is none
    """
    file = bag_of_scan(folder)
    taken = TakenProfiles(with_points=with_points)
    read_written_part(file, taken)
    taken.require_complete(file)
    return taken


def is_being_recorded(folder: Path) -> bool:
    """Return whether a recorder writes the bag in the folder of a scan; false without locks."""
    try:
        with (folder / PART_NAME).open('rb') as stream:
            fcntl.flock(stream, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False


def bag_of_scan(folder: Path) -> Path:
    """
    Return the bag in the folder of a scan, finished or not.

    :raises BagError: there is none
    """
    for name in (PART_NAME, FILE_NAME):
        if (folder / name).is_file():
            return folder / name
    raise BagError(f'{folder / FILE_NAME}: there is no such file; restore the bag of the scan')
