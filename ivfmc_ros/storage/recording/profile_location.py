# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where a profile of a scan is in its bag."""

from dataclasses import dataclass

from ivfmc_ros.storage.messages.profile_header import ProfileHeader


@dataclass(frozen=True, kw_only=True)
class ProfileLocation:
    """
    Where a profile is in the bag; it has been flushed.

    index : index of the message in its topic, from 0
    chunk_offset : offset in the file of the chunk that holds the message, bytes
    """

    header: ProfileHeader
    topic: str
    index: int
    log_time_ns: int
    chunk_offset: int
