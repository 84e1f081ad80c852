# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A plane that cuts a mesh: the faces on one side of it, and the outline in it."""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints

AXES = ('x', 'y', 'z')


@dataclass(frozen=True, kw_only=True)
class CuttingPlane:
    """
    A plane across an axis.

    axis : x, y or z; '' for none
    position : meters along it; what lies beyond is hidden
    """

    axis: str = ''
    position: float = 0.0

    def near_side(self, points_xyz: Floats) -> Floats:
        """Return those of (n, 3) points that the plane does not hide."""
        if self.axis not in AXES:
            return points_xyz
        return np.asarray(points_xyz[points_xyz[:, AXES.index(self.axis)] <= self.position])


def cut_mesh(vertices_xyz: Floats, faces: Ints, section: CuttingPlane) -> tuple[Bools, Floats]:
    """
    Cut a mesh.

    vertices_xyz, faces : (n, 3) meters, (m, 3)
    :returns: (m,) which faces lie on the near side of the plane, and (k, 2, 3) segments in it
    """
    if section.axis not in AXES:
        return np.ones(len(faces), dtype=bool), np.zeros((0, 2, 3))
    side = vertices_xyz[:, AXES.index(section.axis)] - section.position
    beyond = side[faces] > 0.0
    number = np.count_nonzero(beyond, axis=1)
    return number == 0, _outline(vertices_xyz, faces, side, beyond, number)


def _outline(
    vertices_xyz: Floats, faces: Ints, side: Floats, beyond: Bools, number: Ints
) -> Floats:
    """Return the segments in which the faces that cross the plane meet it."""
    crossing = (number == 1) | (number == 2)
    corners, is_beyond = faces[crossing], beyond[crossing]
    if not len(corners):
        return np.zeros((0, 2, 3))
    # the corner that is alone on its side; both edges to it cross the plane
    alone = np.where(
        np.count_nonzero(is_beyond, axis=1) == 1,
        np.argmax(is_beyond, axis=1),
        np.argmin(is_beyond, axis=1),
    )
    rows = np.arange(len(corners))
    apex = corners[rows, alone]
    ends = []
    for step in (1, 2):
        other = corners[rows, (alone + step) % 3]
        share = side[apex] / (side[apex] - side[other])
        ends.append(
            vertices_xyz[apex] + share[:, None] * (vertices_xyz[other] - vertices_xyz[apex])
        )
    return np.stack(ends, axis=1)
