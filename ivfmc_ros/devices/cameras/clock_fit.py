# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Clock of a camera in steady time, from its timestamps and the arrivals of its images.

An image arrives after its timestamp, and never before: the fitted line is the lower envelope of
arrival minus timestamp (as for network clocks: Moon, Skelly, Towsley, INFOCOM 1999), here with the
drift from the least delays in the first and the last third of the window.
"""

from collections import deque

_WINDOW = 400  # images; at 15 a second half a minute, in which two clocks drift by 3 ms at most
# Images and seconds from which on the drift is estimated; before it counts as none.
_DRIFT_IMAGES, _DRIFT_NS = 200, 8_000_000_000
_MAX_DRIFT = 5e-4  # quartz clocks differ by 1e-4 at most; more is a delay that has changed


class ClockFit:
    """Turns timestamps of a camera into steady time; both are integer nanoseconds."""

    def __init__(self) -> None:
        self._pairs: deque[tuple[int, int]] = deque(maxlen=_WINDOW)

    def to_steady(self, camera_ns: int, arrived_ns: int) -> int:
        """
        Return the steady time of a timestamp.

        camera_ns : of the camera's clock; a clock that starts again begins a new fit
        arrived_ns : steady time at which the image arrived
        """
        if self._pairs and camera_ns <= self._pairs[-1][0]:
            self._pairs.clear()
        self._pairs.append((camera_ns, arrived_ns - camera_ns))
        drift = self._drift()
        offset = min(value - drift * (at - camera_ns) for at, value in self._pairs)
        return camera_ns + round(offset)

    def _drift(self) -> float:
        """Return nanoseconds of offset per nanosecond of the camera's clock."""
        pairs = list(self._pairs)
        if len(pairs) < _DRIFT_IMAGES or pairs[-1][0] - pairs[0][0] < _DRIFT_NS:
            return 0.0
        third = len(pairs) // 3
        early = min(pairs[:third], key=lambda pair: pair[1])
        late = min(pairs[-third:], key=lambda pair: pair[1])
        drift = (late[1] - early[1]) / (late[0] - early[0])
        return max(-_MAX_DRIFT, min(_MAX_DRIFT, drift))
