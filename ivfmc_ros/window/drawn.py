# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Points and meshes of the 3-D view, with the values that their colors can show."""

from dataclasses import dataclass
from dataclasses import field

import numpy as np

from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Profile

# What colors can show.
LASER, HEIGHT, SIGMA, BRIGHTNESS, DEVIATION, TEXTURE, PLAIN = (
    'laser',
    'height',
    'uncertainty',
    'brightness',
    'deviation',
    'texture',
    'plain',
)
# Modes of points; deviation needs a nominal.
POINT_MODES = (LASER, HEIGHT, SIGMA, BRIGHTNESS)


@dataclass(frozen=True, eq=False, kw_only=True)
class DrawnPoints:
    """
    Points to draw.

    points_xyz : (n, 3) meters, frame ``turntable``
    laser : (n,) index; sigma : (n,) meters; intensity : (n,) DN
    """

    points_xyz: Floats
    laser: Ints
    sigma: Floats
    intensity: Floats

    @classmethod
    def of_profile(cls, profile: Profile) -> 'DrawnPoints':
        """Return the points of a profile."""
        return cls(
            points_xyz=profile.points_xyz,
            laser=np.full(len(profile), profile.laser),
            sigma=profile.sigma,
            intensity=profile.intensity,
        )

    @classmethod
    def merged(cls, parts: list['DrawnPoints']) -> 'DrawnPoints':
        """Return the points of all parts."""
        return cls(
            points_xyz=np.concatenate([part.points_xyz for part in parts]),
            laser=np.concatenate([part.laser for part in parts]),
            sigma=np.concatenate([part.sigma for part in parts]),
            intensity=np.concatenate([part.intensity for part in parts]),
        )

    def every(self, step: int) -> 'DrawnPoints':
        """Return each ``step``-th point."""
        return DrawnPoints(
            points_xyz=self.points_xyz[::step],
            laser=self.laser[::step],
            sigma=self.sigma[::step],
            intensity=self.intensity[::step],
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class DrawnMesh:
    """
    A mesh to draw.

    vertices_xyz, faces : (n, 3) meters, (m, 3)
    values : (n,) meters or DN of the vertices, by the name of a mode
    tolerance : meters to either side of zero of a deviation; None for none
    """

    vertices_xyz: Floats
    faces: Ints
    values: dict[str, Floats] = field(default_factory=dict)
    tolerance: float | None = None

    @property
    def modes(self) -> tuple[str, ...]:
        """Modes in which it can be colored."""
        return (PLAIN, HEIGHT, *self.values)
