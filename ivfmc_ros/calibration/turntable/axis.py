# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What is seen of a turning platter, and where its axis, its markers and its angles are.

A board, or corners of single markers, lie on the platter and turn with it. Corners of single
markers are free points in space: the paper is not flat (corners stand off by up to a
millimetre), and blur and light make their squares too small or too large.
"""

from dataclasses import dataclass
from dataclasses import replace

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints


@dataclass(frozen=True, eq=False, kw_only=True)
class Sightings:
    """
    Corners of things on the platter, one row a corner.

    picture : (n,) index of the picture
    group : (n,) index of the rigid thing: a board, or a marker
    corner : (n,) index of the corner in its thing
    local_xyz : (n, 3) metres, the corner in the frame of its thing
    uv : (n, 2) pixel, freed of lens distortion: focal lengths times x/z, y/z
    inward : (n, 2) how the corner moves if light eats one pixel of each edge; 0 where it cannot
    """

    picture: Ints
    group: Ints
    corner: Ints
    local_xyz: Floats
    uv: Floats
    inward: Floats

    def __len__(self) -> int:
        return len(self.picture)

    def chosen(self, keep: Bools) -> 'Sightings':
        """Return only the chosen rows, (n,) bool."""
        return Sightings(
            picture=self.picture[keep],
            group=self.group[keep],
            corner=self.corner[keep],
            local_xyz=self.local_xyz[keep],
            uv=self.uv[keep],
            inward=self.inward[keep],
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class Heights:
    """
    Stripe points of the bare platter.

    points_xyz : (n, 3) metres, ``camera_optical_frame``
    sigma : (n,) metres, 1 sigma of their height
    """

    points_xyz: Floats
    sigma: Floats

    @classmethod
    def none(cls) -> 'Heights':
        """Return no points."""
        return cls(points_xyz=np.empty((0, 3)), sigma=np.empty(0))

    def __len__(self) -> int:
        return len(self.sigma)


@dataclass(frozen=True, eq=False, kw_only=True)
class Axis:
    """
    The state of the adjustment.

    camera_from_base : (4, 4); the origin is where the axis meets the plane of the corners
    tilt : (2,) slopes of that plane against the axis
    scale : length of a board over what it is said to be
    bloom : pixels by which light paper eats into each edge of a marker
    layout : (groups, 3) x, y in metres and yaw in radians of each thing on the platter; or with
        ``free`` (groups * 4, 3) x, y and height over the platter of each marker's corner
    angles : (pictures,) radians
    """

    camera_from_base: Floats
    tilt: Floats
    scale: float
    layout: Floats
    angles: Floats
    bloom: float = 0.0
    free: bool = False

    def platter_points(self, sightings: Sightings) -> Floats:
        """Return (n, 3) metres: where the seen corners are in the frame ``turntable``."""
        if self.free:
            points: Floats = self.layout[4 * sightings.group + sightings.corner].copy()
        else:
            points = _placed(self.layout[sightings.group], self.scale * sightings.local_xyz)
        points[:, 2] += points[:, :2] @ self.tilt
        return points

    def freed(self, corners_xyz: Floats) -> 'Axis':
        """Return the state with the corners (4, 3) of each marker as free points."""
        corners = np.tile(corners_xyz, (len(self.layout), 1))
        layout = _placed(np.repeat(self.layout, 4, axis=0), corners)
        return replace(self, layout=layout, free=True)

    def turned_layout(self, turn: float, angles: Floats) -> 'Axis':
        """Return the state with layout and tilt turned by ``turn``, and other angles."""
        R = transforms.rotation_z(turn)[:2, :2]
        layout = self.layout.copy()
        layout[:, :2] = layout[:, :2] @ R.T
        if not self.free:
            layout[:, 2] += turn
        tilt = np.asarray(R @ self.tilt)
        return replace(self, layout=layout, tilt=tilt, angles=angles)

    def radius(self, sightings: Sightings) -> float:
        """Return the greatest distance in metres of a corner from the axis."""
        return float(np.linalg.norm(self.platter_points(sightings)[:, :2], axis=1).max())

    def mean_side(self) -> float:
        """Return the mean side in metres of the markers, whose corners are free."""
        quads = self.layout.reshape(-1, 4, 3)
        return float(np.linalg.norm(np.roll(quads, -1, axis=1) - quads, axis=2).mean())

    def camera_points(self, sightings: Sightings) -> Floats:
        """Return (n, 3) metres: where the seen corners are in ``camera_optical_frame``."""
        turn = transforms.rotation_z(self.angles[sightings.picture])
        base = np.einsum('nij,nj->ni', turn, self.platter_points(sightings))
        return transforms.apply(self.camera_from_base, base)

    def heights(self, points_xyz: Floats) -> Floats:
        """Return (n,) metres: height above the platter of points of the camera's frame."""
        return transforms.apply(transforms.invert(self.camera_from_base), points_xyz)[:, 2]


def _placed(layout: Floats, local_xyz: Floats) -> Floats:
    x, y, yaw = layout.T
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.stack(
        [
            x + cos * local_xyz[:, 0] - sin * local_xyz[:, 1],
            y + sin * local_xyz[:, 0] + cos * local_xyz[:, 1],
            local_xyz[:, 2],
        ],
        axis=1,
    )
