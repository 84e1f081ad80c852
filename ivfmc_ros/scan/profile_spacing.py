# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Distances of neighboring profiles on the part: the angle between them times their radius."""

from collections.abc import Iterator
from collections.abc import Sequence
from itertools import pairwise

from ivfmc_ros.scan.angle_ranges import Range

# Angle of a profile, radians, and distance of its outer points from the table axis, meters.
Place = tuple[float, float]


def greatest_spacing(places: Sequence[Place]) -> float:
    """Return the greatest distance, meters, of profiles in the order of their angles."""
    return max((spacing for _, spacing in _spacings(places)), default=0.0)


def wide_ranges(places: Sequence[Place], limit: float) -> list[Range]:
    """Return the ranges between neighbors that are farther apart than a limit, meters."""
    return [between for between, spacing in _spacings(places) if spacing > limit]


def greatest_radius(places: Sequence[Place], within: Range) -> float:
    """Return the greatest radius of the profiles in a range of angles, meters; 0 for none."""
    low, high = within
    return max((radius for angle, radius in places if low <= angle <= high), default=0.0)


def _spacings(places: Sequence[Place]) -> Iterator[tuple[Range, float]]:
    """Yield the range between neighbors, and their distance at the greater radius of both."""
    for (begin, first), (end, second) in pairwise(places):
        yield (begin, end), max(first, second) * (end - begin)
