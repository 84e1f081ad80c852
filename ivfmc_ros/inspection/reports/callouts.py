# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Placement of numbered labels in the margins of a picture, with leader lines to its features.

Boundary labeling (Bekos et al. 2007): labels on the same side do not overlap, and the leader
lines of a side do not cross. Positions are pixels of the drawing, x right, y down.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

# Width and height of a label, and the distance between the centers of two.
LABEL_WIDTH, LABEL_HEIGHT = 34.0, 18.0
_PITCH = LABEL_HEIGHT + 4.0
# Of the margin on each side of the picture.
MARGIN = LABEL_WIDTH + 26.0

Point = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Callout:
    """
    A label and the feature that it names.

    number : of the feature
    anchor : on the feature; center : of the label
    """

    number: int
    anchor: Point
    center: Point

    @property
    def leader(self) -> tuple[Point, Point]:
        """The line from the inner edge of the label to the feature."""
        side = 1.0 if self.center[0] < self.anchor[0] else -1.0
        return (self.center[0] + side * LABEL_WIDTH / 2, self.center[1]), self.anchor


def place_callouts(anchors: Sequence[tuple[int, Point]], size: tuple[int, int]) -> list[Callout]:
    """
    Place a label for each feature beside a picture.

    anchors : number and position in the picture of each feature, the most important first
    size : (width, height) of the picture; the drawing has ``MARGIN`` more on the left and right
    :returns: those for which there is room
    """
    width, height = size
    room = int(height // _PITCH)
    shown = sorted(anchors[: 2 * room], key=lambda item: item[1][0])
    middle = sum(x < width / 2 for _, (x, _) in shown)
    # each side has room for so many
    cut = min(max(middle, len(shown) - room), room)
    left = _side(shown[:cut], LABEL_WIDTH / 2 + 2, height)
    right = _side(shown[cut:], width + 2 * MARGIN - LABEL_WIDTH / 2 - 2, height)
    return [*left, *right]


def _side(anchors: Sequence[tuple[int, Point]], x: float, height: float) -> list[Callout]:
    shifted = [(number, (u + MARGIN, v)) for number, (u, v) in anchors]
    shifted.sort(key=lambda item: item[1][1])
    rows = _spread([v for _, (_, v) in shifted], height)
    callouts = [
        Callout(number=number, anchor=anchor, center=(x, row))
        for (number, anchor), row in zip(shifted, rows, strict=True)
    ]
    # each exchange makes the sum of the lengths shorter, so that this ends
    while (crossing := _crossing(callouts)) is not None:
        one, other = crossing
        first, second = callouts[one], callouts[other]
        callouts[one] = Callout(number=first.number, anchor=first.anchor, center=second.center)
        callouts[other] = Callout(number=second.number, anchor=second.anchor, center=first.center)
    return callouts


def _spread(wanted: Sequence[float], height: float) -> list[float]:
    """Return rows near the wanted ones, in their order, that are ``_PITCH`` apart."""
    rows: list[float] = []
    low = LABEL_HEIGHT / 2
    for row in wanted:
        rows.append(max(row, low))
        low = rows[-1] + _PITCH
    high = height - LABEL_HEIGHT / 2
    for index in reversed(range(len(rows))):
        rows[index] = min(rows[index], high)
        high = rows[index] - _PITCH
    return rows


def _crossing(callouts: Sequence[Callout]) -> tuple[int, int] | None:
    for one, other in combinations(range(len(callouts)), 2):
        if _intersect(callouts[one].leader, callouts[other].leader):
            return one, other
    return None


def _intersect(one: tuple[Point, Point], other: tuple[Point, Point]) -> bool:
    def side(line: tuple[Point, Point], point: Point) -> float:
        (ax, ay), (bx, by) = line
        return (bx - ax) * (point[1] - ay) - (by - ay) * (point[0] - ax)

    return (
        side(one, other[0]) * side(one, other[1]) < 0.0
        and side(other, one[0]) * side(other, one[1]) < 0.0
    )
