# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The distance between two points that were picked in the 3-D view."""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.model import Floats

# A point is picked within this angle of the ray of a click, radians: some 5 pixels.
_CONE = 0.006


@dataclass(frozen=True, eq=False, kw_only=True)
class Measurement:
    """Two picked points, (3,) meters each, frame ``turntable``."""

    first_xyz: Floats
    second_xyz: Floats

    @property
    def distance(self) -> float:
        """Meters."""
        return float(np.linalg.norm(self.second_xyz - self.first_xyz))

    @property
    def text(self) -> str:
        """The distance and its components in mm."""
        dx, dy, dz = 1e3 * (self.second_xyz - self.first_xyz)
        return f'{1e3 * self.distance:.2f} mm  (x {dx:+.2f}, y {dy:+.2f}, z {dz:+.2f})'

    @staticmethod
    def pick(points_xyz: Floats, origin: Floats, direction: Floats) -> Floats | None:
        """
        Return the point that a ray meets first.

        points_xyz : (n, 3) meters
        origin, direction : (3,) of the ray; the direction need not be a unit vector
        :returns: (3,), or None where no point lies within a narrow cone about the ray
        """
        along = direction / np.linalg.norm(direction)
        offset = points_xyz - origin
        depth = offset @ along
        aside = np.linalg.norm(offset - depth[:, None] * along, axis=1)
        inside = np.flatnonzero((depth > 0.0) & (aside <= _CONE * depth))
        if not len(inside):
            return None
        # the surface in front, not the one behind it: of the nearest ones the best aimed at
        front = inside[depth[inside] <= depth[inside].min() * (1.0 + _CONE)]
        return np.asarray(points_xyz[front[np.argmin(aside[front])]])
