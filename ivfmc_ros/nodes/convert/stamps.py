# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""builtin_interfaces/Time to integer nanoseconds and back."""

from builtin_interfaces.msg import Time
from std_msgs.msg import Header

_NANOSECONDS = 1_000_000_000


def nanoseconds(stamp: Time) -> int:
    """Return a stamp as nanoseconds since the epoch."""
    return int(stamp.sec) * _NANOSECONDS + int(stamp.nanosec)


def header(stamp_ns: int, frame_id: str) -> Header:
    """Return a header with a stamp given in nanoseconds."""
    seconds, rest = divmod(int(stamp_ns), _NANOSECONDS)
    return Header(stamp=Time(sec=seconds, nanosec=rest), frame_id=frame_id)
