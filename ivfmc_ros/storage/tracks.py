# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What table and lasers did over time, by what they reported."""

from collections.abc import Iterable
from collections.abc import Sequence
from typing import Any

import numpy as np

from ivfmc_ros.errors import BagError
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.storage.messages import cdr

# What the table does just before the first and after the last report is guessed this far.
TOLERANCE_S = 0.25


class JointTrack:
    """
    The position of the table over time.

    stamps_ns : (n,) int64, ascending
    positions : (n,) float64, radians, continuous: a position that is reported modulo a turn is
        unwrapped
    """

    def __init__(self, stamps_ns: Sequence[int], positions: Sequence[float]) -> None:
        """Sort the reports by their stamps; at least one is needed."""
        stamps, first = np.unique(np.asarray(stamps_ns, dtype=np.int64), return_index=True)
        self.stamps_ns: Ints = stamps
        self.positions: Floats = np.unwrap(np.asarray(positions, dtype=np.float64)[first])

    @classmethod
    def of(cls, messages: Iterable[Any], joint: str, where: str) -> 'JointTrack':
        """
        Collect the reports of one joint from sensor_msgs/JointState.

        One that is no number, as before an axis was homed, is none.

        :raises BagError: no message names the joint, or no position is a number
        """
        stamps: list[int] = []
        positions: list[float] = []
        others: set[str] = set()
        for message in messages:
            stated = dict(zip(message.name, message.position, strict=False))
            others.update(message.name)
            if joint in stated:
                stamps.append(cdr.stamp_ns(message))
                positions.append(float(stated[joint]))
        if not stamps:
            named = ', '.join(sorted(others)) or 'none'
            raise BagError(f'{where}: has no position of joint {joint!r}; joints there: {named}')
        known = np.isfinite(positions)
        if not known.any():
            raise BagError(f'{where}: no position of joint {joint!r} is a finite number')
        return cls(np.compress(known, stamps).tolist(), np.compress(known, positions).tolist())

    def covers(self, stamps_ns: Ints) -> Bools:
        """(n,) bool: whether the table's position at these stamps is known."""
        tolerance = int(TOLERANCE_S * cdr.NANOSECONDS)
        after = stamps_ns >= self.stamps_ns[0] - tolerance
        return np.asarray(after & (stamps_ns <= self.stamps_ns[-1] + tolerance))

    def at(self, stamps_ns: Ints) -> Floats:
        """(n,) float64, radians: interpolated, and at the ends continued as it moved there."""
        # stamps of today lose 200 ns as float64 seconds, their differences nothing
        start = self.stamps_ns[0]
        known = (self.stamps_ns - start) / cdr.NANOSECONDS
        wanted = (stamps_ns - start) / cdr.NANOSECONDS
        first, last = self.positions[0], self.positions[-1]
        before = 2 * first - np.interp(known[0] + TOLERANCE_S, known, self.positions)
        after = 2 * last - np.interp(known[-1] - TOLERANCE_S, known, self.positions)
        times = np.concatenate([[known[0] - TOLERANCE_S], known, [known[-1] + TOLERANCE_S]])
        positions = np.concatenate([[before], self.positions, [after]])
        return np.asarray(np.interp(wanted, times, positions))


class LaserTrack:
    """
    Which laser was on, over time.

    stamps_ns : (n,) int64, ascending; when the lasers were reported as they are in ``lit``
    lit : (n, lasers) bool, in the order of the cell
    """

    def __init__(self, stamps_ns: Ints, lit: Bools) -> None:
        """Sort the reports by their stamps."""
        order = np.argsort(stamps_ns, kind='stable')
        self.stamps_ns = stamps_ns[order]
        self.lit = lit[order]
        changed = (self.lit[1:] != self.lit[:-1]).any(axis=1)
        self.changes_ns: Ints = self.stamps_ns[1:][changed]

    @classmethod
    def of(cls, messages: Iterable[Any], lasers: Sequence[str], where: str) -> 'LaserTrack':
        """
        Collect the reports of the cell's lasers from the list of named scalars.

        A laser of the cell that a message does not name is as it was; one that is not of the
        cell is not looked at.

        :raises BagError: no message names a laser of the cell
        """
        ordered = sorted(messages, key=cdr.stamp_ns)
        named = {name for message in ordered for name in message.name}
        if not named.intersection(lasers):
            raise BagError(
                f'{where}: names none of the lasers {", ".join(lasers)}; '
                f'lasers there: {", ".join(sorted(named)) or "none"}'
            )
        state = dict.fromkeys(lasers, False)
        rows = []
        for message in ordered:
            stated = zip(message.name, message.position, strict=False)
            state.update({name: value > 0.5 for name, value in stated if name in state})
            rows.append(list(state.values()))
        stamps = np.array([cdr.stamp_ns(message) for message in ordered], dtype=np.int64)
        return cls(stamps, np.array(rows, dtype=bool))

    def during(self, stamp_ns: int, exposure_ns: int) -> tuple[int | None, str]:
        """
        Return the laser that was on during an exposure, and else None and why there is none.

        :returns: index of the laser in the order of the cell, and ''; or None and the reason
        """
        latest = int(np.searchsorted(self.stamps_ns, stamp_ns, side='right')) - 1
        if latest < 0:
            return None, 'laser off'
        begin = np.searchsorted(self.changes_ns, stamp_ns, side='right')
        end = np.searchsorted(self.changes_ns, stamp_ns + exposure_ns, side='right')
        if end > begin:
            return None, 'laser changed'
        on = np.flatnonzero(self.lit[latest])
        if len(on) != 1:
            return None, 'two lasers on' if len(on) else 'laser off'
        return int(on[0]), ''
