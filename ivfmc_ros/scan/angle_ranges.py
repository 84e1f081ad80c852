# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Ranges of table angles: what a set of them leaves open, their union, and their text."""

from collections.abc import Sequence
import math

# A range of angles, from and to, radians.
Range = tuple[float, float]

_TURN = 2.0 * math.pi
# Angle differences below this, radians, are rounding: angles are published in single precision.
_ROUNDING = 1e-4


def degrees_of(hole: Range) -> list[float]:
    """Return a range of angles in degrees, rounded."""
    return [round(math.degrees(angle), 1) for angle in hole]


def gaps(begin: float, end: float, runs: Sequence[Range]) -> list[Range]:
    """Return the parts of a range of angles that no run covers, ascending."""
    found = []
    reached = begin
    for low, high in sorted(runs):
        if min(low, end) > reached:
            found.append((reached, min(low, end)))
        reached = max(reached, high)
        if reached >= end:
            return found
    return [*found, (reached, end)] if end > reached else found


def merged(holes: Sequence[Range]) -> list[Range]:
    """Return the union of ranges, ascending."""
    found: list[Range] = []
    for low, high in sorted(holes):
        if found and low <= found[-1][1]:
            found[-1] = found[-1][0], max(found[-1][1], high)
        else:
            found.append((low, high))
    return found


def joined(ranges: Sequence[Range], most: int) -> list[Range]:
    """Return ascending ranges, the nearest of them joined until there are at most so many."""
    found = list(ranges)
    while len(found) > most:
        at = min(range(len(found) - 1), key=lambda k: found[k + 1][0] - found[k][1])
        found[at : at + 2] = [(found[at][0], found[at + 1][1])]
    return found


def without_turns(hole: Range) -> Range:
    """Return a range of angles without the whole turns before it."""
    turns = _TURN * math.floor(hole[0] / _TURN + _ROUNDING)
    return max(0.0, hole[0] - turns), hole[1] - turns
