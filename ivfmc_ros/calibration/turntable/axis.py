# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Observations and state of the turntable calibration: axis, layout on the platter, table angles.

A board, or single markers, lie on the platter and turn with it. Corners of single markers are
free points in space: the paper is not flat (corners are up to 1 mm above the platter), and blur
and blooming make the squares appear too small or too large.
"""

from dataclasses import dataclass
from dataclasses import replace

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints


@dataclass(frozen=True, eq=False, kw_only=True)
class CornerObservations:
    """
    Observed corners of targets on the platter, one row per corner.

    picture : (n,) index of the picture
    group : (n,) index of the rigid target: a board, or a marker
    corner : (n,) index of the corner in its target
    local_xyz : (n, 3) meters, the corner in the frame of its target
    uv : (n, 2) pixel, without lens distortion: focal lengths times x/z, y/z
    bloom_jacobian : (n, 2) derivative of ``uv`` by ``AxisState.bloom``; 0 for a chessboard
    """

    picture: Ints
    group: Ints
    corner: Ints
    local_xyz: Floats
    uv: Floats
    bloom_jacobian: Floats

    def __len__(self) -> int:
        return len(self.picture)

    def select(self, keep: Bools) -> 'CornerObservations':
        """Return the rows for which ``keep``, (n,) bool, is true."""
        return CornerObservations(
            picture=self.picture[keep],
            group=self.group[keep],
            corner=self.corner[keep],
            local_xyz=self.local_xyz[keep],
            uv=self.uv[keep],
            bloom_jacobian=self.bloom_jacobian[keep],
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class PlatterPoints:
    """
    Triangulated stripe points on the bare platter.

    points_xyz : (n, 3) meters, ``camera_optical_frame``
    sigma : (n,) meters, 1 sigma of their height above the platter
    """

    points_xyz: Floats
    sigma: Floats

    @classmethod
    def empty(cls) -> 'PlatterPoints':
        """Return an empty set."""
        return cls(points_xyz=np.empty((0, 3)), sigma=np.empty(0))

    def __len__(self) -> int:
        return len(self.sigma)


@dataclass(frozen=True, eq=False, kw_only=True)
class AxisState:
    """
    Parameters of the adjustment.

    camera_from_base : (4, 4) rigid; the origin is where the axis meets the plane of the corners
    tilt : (2,) slopes of that plane in x and y, against the plane normal to the axis
    scale : measured over nominal length of a board
    layout : (groups, 3) x, y in meters and yaw in radians of each target on the platter; with
        ``free_corners`` (groups * 4, 3) x, y and height in meters of each marker corner
    angles : (pictures,) radians
    bloom : pixels by which light paper blooms into each edge of a marker
    free_corners : whether marker corners are free points
    """

    camera_from_base: Floats
    tilt: Floats
    scale: float
    layout: Floats
    angles: Floats
    bloom: float = 0.0
    free_corners: bool = False

    def corners_in_platter(self, observations: CornerObservations) -> Floats:
        """Return (n, 3) meters: the observed corners in the frame ``turntable``."""
        if self.free_corners:
            points: Floats = self.layout[4 * observations.group + observations.corner].copy()
        else:
            points = _layout_points(
                self.layout[observations.group], self.scale * observations.local_xyz
            )
        points[:, 2] += points[:, :2] @ self.tilt
        return points

    def with_free_corners(self, corners_xyz: Floats) -> 'AxisState':
        """Return the state with the corners of each marker, (4, 3) meters, as free points."""
        corners = np.tile(corners_xyz, (len(self.layout), 1))
        layout = _layout_points(np.repeat(self.layout, 4, axis=0), corners)
        return replace(self, layout=layout, free_corners=True)

    def with_rotated_layout(self, turn: float, angles: Floats) -> 'AxisState':
        """Return the state with layout and tilt rotated by ``turn`` radians, and new angles."""
        R = transforms.rotation_z(turn)[:2, :2]
        layout = self.layout.copy()
        layout[:, :2] = layout[:, :2] @ R.T
        if not self.free_corners:
            layout[:, 2] += turn
        tilt = np.asarray(R @ self.tilt)
        return replace(self, layout=layout, tilt=tilt, angles=angles)

    def radius(self, observations: CornerObservations) -> float:
        """Return the greatest distance in meters of an observed corner from the axis."""
        return float(np.linalg.norm(self.corners_in_platter(observations)[:, :2], axis=1).max())

    @property
    def size(self) -> float:
        """Mean side of the markers in meters (``free_corners``), or scale of the board."""
        return self.mean_side() if self.free_corners else self.scale

    def mean_side(self) -> float:
        """Return the mean side in meters of the markers (``free_corners`` only)."""
        quads = self.layout.reshape(-1, 4, 3)
        return float(np.linalg.norm(np.roll(quads, -1, axis=1) - quads, axis=2).mean())

    def corners_in_camera(self, observations: CornerObservations) -> Floats:
        """Return (n, 3) meters: the observed corners in ``camera_optical_frame``."""
        turn = transforms.rotation_z(self.angles[observations.picture])
        base = np.einsum('nij,nj->ni', turn, self.corners_in_platter(observations))
        return transforms.apply(self.camera_from_base, base)

    def heights(self, points_xyz: Floats) -> Floats:
        """Return (n,) meters: height above the platter of (n, 3) points in the camera frame."""
        return transforms.apply(transforms.invert(self.camera_from_base), points_xyz)[:, 2]


def _layout_points(layout: Floats, local_xyz: Floats) -> Floats:
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
