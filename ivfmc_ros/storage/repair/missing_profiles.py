# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Finds the profiles that a recording lacks by the gaps in their numbers (seq)."""

from collections.abc import Iterable
from collections.abc import Iterator
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
import math
from typing import Protocol


class ProfilePlace(Protocol):
    """What is known of a profile: its view and its table angle, radians."""

    @property
    def view(self) -> int:
        """Number of the view."""

    @property
    def angle(self) -> float:
        """Table angle, radians."""


@dataclass(frozen=True, kw_only=True)
class MissingProfiles:
    """
    Profiles ``first_seq`` to ``last_seq`` that are not in a recording.

    views : views that they can belong to
    from_angle, to_angle : table angles, radians, between which they were taken; NaN where unknown
    """

    first_seq: int
    last_seq: int
    views: tuple[int, ...]
    from_angle: float
    to_angle: float

    @property
    def count(self) -> int:
        """Number of profiles."""
        return self.last_seq - self.first_seq + 1

    def __str__(self) -> str:
        seqs = f'{self.first_seq} to {self.last_seq}' if self.count > 1 else f'{self.first_seq}'
        views = ' or '.join(map(str, self.views)) or 'unknown'
        ends = [
            'unknown' if math.isnan(angle) else f'{math.degrees(angle):.2f} deg'
            for angle in (self.from_angle, self.to_angle)
        ]
        return (
            f'profile{"s" if self.count > 1 else ""} {seqs} (view {views}, table angle '
            f'{ends[0]} to {ends[1]})'
        )


def find_missing_profiles(
    found: Mapping[int, ProfilePlace], acknowledged: Mapping[int, ProfilePlace]
) -> tuple[MissingProfiles, ...]:
    """
    Return the runs of missing profiles by seq.

    found : profiles of the recording by seq
    acknowledged : profiles by seq that the catalogue lists, which are known to have been written
    """
    last = max([-1, *found, *acknowledged])
    missing = (seq for seq in range(last + 1) if seq not in found)
    return tuple(_describe(first, last, found, acknowledged) for first, last in _runs(missing))


def _describe(
    first: int,
    last: int,
    found: Mapping[int, ProfilePlace],
    acknowledged: Mapping[int, ProfilePlace],
) -> MissingProfiles:
    listed = [acknowledged[seq] for seq in range(first, last + 1) if seq in acknowledged]
    before = found.get(first - 1)
    after = found.get(last + 1)
    # where the catalogue knows all of them, their own angles; else those of the neighbors
    is_listed = len(listed) == last - first + 1
    places = listed if is_listed else [place for place in (before, *listed, after) if place]
    start = places[0] if is_listed else before
    end = places[-1] if is_listed else after
    return MissingProfiles(
        first_seq=first,
        last_seq=last,
        views=tuple(sorted({place.view for place in places})),
        from_angle=start.angle if start else math.nan,
        to_angle=end.angle if end else math.nan,
    )


def _runs(numbers: Iterable[int]) -> Iterator[tuple[int, int]]:
    """Yield the first and last number of each run of consecutive ascending numbers."""
    ordered = list(numbers)
    breaks = [0, *(k for k, (a, b) in enumerate(pairwise(ordered), 1) if b != a + 1)]
    for begin, end in zip(breaks, [*breaks[1:], len(ordered)], strict=True):
        if end > begin:
            yield ordered[begin], ordered[end - 1]
