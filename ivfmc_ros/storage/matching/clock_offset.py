# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether the stamps of images and of the table are of one clock, and what to do if not."""

# Offset of the clocks from which it is said, seconds: networks and queues delay by less.
MAX_OFFSET_S = 2.0
# TAI, the time scale of PTP, is ahead of UTC by these seconds since 2017.
_TAI_S = 37.0
_TAI_TOLERANCE_S = 0.5


def clocks_differ(ahead_s: float) -> bool:
    """Return whether clocks differ whose stamps are ``ahead_s`` seconds apart."""
    return abs(ahead_s) > MAX_OFFSET_S


def clock_text(ahead_s: float) -> str:
    """Return what is said of images whose stamps are ``ahead_s`` seconds ahead of the table's."""
    direction = 'ahead of' if ahead_s > 0.0 else 'behind'
    text = f'the stamps of images are {abs(ahead_s):.1f} s {direction} those of the table; '
    if abs(abs(ahead_s) - _TAI_S) < _TAI_TOLERANCE_S:
        return f'{text}one of the two has TAI, the time of PTP, and not UTC: set its UTC offset'
    return f'{text}synchronize the clocks of the two publishers'
