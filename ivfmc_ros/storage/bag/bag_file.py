# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the readers of all bag formats return: topics and encoded messages of one file."""

from collections.abc import Collection
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

# An encoded message; a memoryview where a copy would cost too much.
Encoded = bytes | memoryview


@dataclass(frozen=True, kw_only=True)
class Topic:
    """
    A topic of a bag.

    msgtype : such as 'sensor_msgs/msg/Image'; '' where the bag has no schema of it
    encoding : of the messages, such as 'cdr'
    count : number of messages
    schema_encoding, definition : 'ros2msg' or 'ros2idl', and the message definition in it
    """

    name: str
    msgtype: str
    encoding: str
    count: int
    schema_encoding: str = ''
    definition: str = ''


@dataclass(frozen=True, kw_only=True)
class RawMessage:
    """An encoded message; ``index`` is its index in its topic, from 0."""

    topic: str
    index: int
    log_time_ns: int
    data: Encoded


@dataclass(frozen=True, kw_only=True)
class FileContents:
    """
    The topics of one file.

    topics : a topic may be there more than once
    fault : what is damaged, such as 'is cut off', or '': the topics are those of the intact part
    remark : what was missing or damaged and did not prevent reading
    """

    topics: list[Topic]
    fault: str = ''
    remark: str = ''


class FileDamage(Exception):  # noqa: N818 - it is no error where a file is salvaged
    """A file is damaged; the text says how, such as 'is cut off'."""


class BagFormat(Protocol):
    """A module that reads files of one format."""

    # First bytes of the files.
    MAGIC: bytes

    def read_contents(self, file: Path, *, use_index: bool) -> FileContents:
        """
        Return the topics of a file.

        use_index : read the index of the file, where it has one, and not all messages
        :raises BagError: the file cannot be read
        """

    def read_messages(
        self,
        file: Path,
        topics: Collection[str] | None,
        *,
        salvage: bool,
        validate_crcs: bool = True,
    ) -> Iterator[tuple[str, int, Encoded]]:
        """
        Yield topic, log time in nanoseconds and data of the messages of some topics.

        Messages of other topics may be among them.

        topics : None: all
        salvage : leave out what is damaged
        validate_crcs : False where the file was read before: its CRCs were checked then
        :raises FileDamage: without ``salvage``, after the last intact message
        :raises BagError: the file cannot be read
        """
