# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Surface that the working volume cuts: stripes that go on beyond its radius or top."""

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from ivfmc_ros.cell.volume import Volume
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats

# Fraction of the pictures whose stripe is cut from which the part is said to be cut: a part that
# is off the center is cut over a part of the turn only. Fewer are reflections.
_MIN_SHARE = 0.03
_MIN_PICTURES = 3
# The volume that would hold the part is known from a few pictures: margin, and the steps to which
# it is rounded up, meters.
_MARGIN = 1.03
_STEP = 1e-3


@dataclass(frozen=True, kw_only=True)
class Clipping:
    """
    Whether the working volume cuts the part.

    pictures_radius, pictures_top : pictures in which the stripe goes on beyond radius or top
    radius, top : meters, the least values that hold what the pictures show; None if not cut, or
        unknown without pictures
    advice : what the operator can do
    """

    pictures_radius: int
    pictures_top: int
    radius: float | None = None
    top: float | None = None
    advice: str


def find_cuts(
    points_xyz: Floats, inside: Bools, volume: Volume, max_distance: float
) -> tuple[bool, bool]:
    """
    Return whether a stripe goes on beyond the radius, and beyond the top of a volume.

    A point that the volume removes has a neighbor on the stripe that it keeps. The platter may be
    larger than the volume: what is less than ``max_distance`` above the bottom is not looked at.

    points_xyz : (n, 3) meters, along the stripe; inside : (n,) which of them the volume keeps
    max_distance : meters between neighbors on the stripe
    """
    near = np.linalg.norm(np.diff(points_xyz, axis=0), axis=1) < max_distance
    border = np.flatnonzero(near & (inside[1:] != inside[:-1]))
    removed = points_xyz[np.where(inside[border], border + 1, border)]
    removed = removed[removed[:, 2] > volume.bottom + max_distance]
    beyond = np.hypot(removed[:, 0], removed[:, 1]) > volume.radius
    return bool(beyond.any()), bool((removed[:, 2] > volume.top).any())


def connected_extent(
    points_xyz: Floats, volume: Volume, max_distance: float
) -> tuple[float, float]:
    """
    Return the greatest radius and height of the stripe segments that reach into a volume.

    points_xyz : (n, 3) meters, along the stripe, also beyond the volume
    """
    gaps = np.linalg.norm(np.diff(points_xyz, axis=0), axis=1) >= max_distance
    radius, top = 0.0, -math.inf
    for segment in np.split(points_xyz, np.flatnonzero(gaps) + 1):
        if volume.contains(segment).any():
            radius = max(radius, float(np.hypot(segment[:, 0], segment[:, 1]).max()))
            top = max(top, float(segment[:, 2].max()))
    return radius, top


def judge_clipping(
    pictures: int,
    cut_radius: int,
    cut_top: int,
    volume: Volume,
    extents: Sequence[tuple[float, float]] = (),
) -> Clipping | None:
    """
    Return how the volume cuts the part; None if it does not.

    extents : radius and height of the part in some pictures, meters, see ``connected_extent``
    """
    least = max(_MIN_PICTURES, math.ceil(_MIN_SHARE * pictures))
    lines, needed = [], {}
    for index, (name, count, limit) in enumerate(
        (('radius', cut_radius, volume.radius), ('top', cut_top, volume.top))
    ):
        if count < least:
            continue
        seen = max((extent[index] for extent in extents), default=0.0)
        if seen > limit:
            needed[name] = round(math.ceil(_MARGIN * seen / _STEP) * _STEP, 6)
        wanted = f'at least {needed[name]:g} m' if name in needed else 'larger'
        lines.append(
            f'the surface goes on beyond the {name} of the working volume ({limit:g} m) in '
            f'{count} of {pictures} pictures and is cut there; set {name} to {wanted}'
        )
    if not lines:
        return None
    return Clipping(
        pictures_radius=cut_radius,
        pictures_top=cut_top,
        radius=needed.get('radius'),
        top=needed.get('top'),
        advice='; '.join(lines),
    )
