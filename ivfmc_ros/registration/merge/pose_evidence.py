# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Evidence for and against a pose: surfels that agree, differ, or should have been occluded.

A pose is contradicted where the surfaces lie beside each other farther than the noise, and where
the camera has seen a surfel through the other surface (free-space violation).
"""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.registration.merge.bodies import ClampedSurface
from ivfmc_ros.registration.merge.nearest_grid import NearestGrid

# Least cosine between the normals of corresponding surfels.
_MIN_COSINE = 0.8
# Greatest distance of corresponding surfels along the surface and across it, in surfel spacings.
_MAX_TANGENTIAL, _MAX_NORMAL = 1.2, 2.0
# A line of sight crosses a surface if it is this far (in surfel spacings) in front of it and
# behind it within a few steps of one spacing.
_CROSSING, _LAGS = 0.5, (1, 2, 3)
# Surfels of a surface that are tested; bounds the time of the lines of sight.
_MAX_TESTED = 12_000
# Neighboring surfels have correlated errors: contradictions are counted by cubes of this edge (in
# surfel spacings) in which this fraction of the surfels contradicts, and at least two.
_CUBE, _MIN_FRACTION = 3.0, 0.3


@dataclass(frozen=True, eq=False, kw_only=True)
class Evidence:
    """
    Fractions of the surfels of both surfaces at a pose, and where they contradict it.

    agree : lie on the other surface, within the noise
    differ : lie beside it, farther than the noise
    blocked : are seen through the other surface
    contradicting : (cubes,) bool, cubes of both surfaces that contradict the pose
    """

    agree: float
    differ: float
    blocked: float
    contradicting: Bools

    @property
    def against(self) -> float:
        """Fraction of the surfels that contradict the pose."""
        return self.differ + self.blocked

    def worse_than(self, other: 'Evidence') -> float:
        """
        Return by how many sigmas more cubes contradict this pose than another one.

        McNemar's test (1947): cubes that contradict both poses, or neither, do not count.
        """
        here = int(np.count_nonzero(self.contradicting & ~other.contradicting))
        there = int(np.count_nonzero(other.contradicting & ~self.contradicting))
        return (here - there) / float(np.sqrt(max(here + there, 1)))


class SurfaceIndex:
    """
    A surface with an index for nearest surfels and occlusion.

    spacing : of its surfels, meters
    """

    def __init__(self, surface: ClampedSurface, spacing: float) -> None:
        self.surface = surface
        self._spacing = spacing
        radius = float(np.hypot(_MAX_TANGENTIAL, _MAX_NORMAL)) * spacing
        self._grid = NearestGrid.build(surface.surfels.points_xyz, spacing / 2, radius)
        order = np.random.default_rng(0).permutation(len(surface))
        self._tested = surface.selected(order[:_MAX_TESTED])
        cube = np.floor(self._tested.surfels.points_xyz / (_CUBE * spacing)).astype(np.int64)
        self._cube = np.unique(cube, axis=0, return_inverse=True)[1].ravel()

    def evidence(self, target: 'SurfaceIndex', T: Floats, noise: float) -> Evidence:
        """
        Return the evidence for a pose of this surface on a target.

        T : (4, 4) target_from_surface
        noise : meters, normal distance within which surfaces agree
        """
        here = target._compare(self._tested.transformed(T), noise)
        there = self._compare(target._tested.transformed(transforms.invert(T)), noise)
        agree, differ, blocked = (here.mean(axis=1) + there.mean(axis=1)) / 2
        return Evidence(
            agree=float(agree),
            differ=float(differ),
            blocked=float(blocked),
            contradicting=np.concatenate(
                [self._contradicting_cubes(here), target._contradicting_cubes(there)]
            ),
        )

    def _contradicting_cubes(self, compared: Bools) -> Bools:
        against = (compared[1] | compared[2]).astype(np.float64)
        size, count = np.bincount(self._cube), np.bincount(self._cube, weights=against)
        return np.asarray((count >= 2) & (count >= _MIN_FRACTION * size))

    def _compare(self, other: ClampedSurface, noise: float) -> Bools:
        """Return (3, n) which surfels of the other surface agree, differ, are blocked."""
        points, normals = other.surfels.points_xyz, other.surfels.normals
        offset, own_normals, near = self._nearest(points)
        mean_normals = normals + own_normals
        length = np.linalg.norm(mean_normals, axis=1, keepdims=True)
        mean_normals = mean_normals / np.maximum(length, 1e-9)
        normal = np.abs((offset * mean_normals).sum(axis=1))
        tangential = np.sqrt(np.maximum((offset**2).sum(axis=1) - normal**2, 0.0))
        compatible = (normals * own_normals).sum(axis=1) > _MIN_COSINE
        beside = near & compatible & (tangential < _MAX_TANGENTIAL * self._spacing)
        agree = beside & (normal < noise)
        differ = beside & ~agree & (normal < _MAX_NORMAL * self._spacing)
        return np.stack([agree, differ, self._blocks(other) & ~beside])

    def _nearest(self, points_xyz: Floats) -> tuple[Floats, Floats, Bools]:
        """Return the offset from the nearest surfel, its normal, and whether there is one."""
        surfels = self.surface.surfels
        j = self._grid.query(points_xyz)
        return points_xyz - surfels.points_xyz[j], surfels.normals[j], j >= 0

    def _blocks(self, other: ClampedSurface) -> Bools:
        """Return which surfels of the other surface have this surface in their line of sight."""
        length = float(np.linalg.norm(np.ptp(self.surface.surfels.points_xyz, axis=0)))
        steps = self._spacing * np.arange(0.0, length / self._spacing)
        rays = other.surfels.points_xyz[:, None] + steps[None, :, None] * other.sight[:, None]
        offset, normals, near = self._nearest(rays)
        height = (offset * normals).sum(axis=2)
        tangential = np.sqrt(np.maximum((offset**2).sum(axis=2) - height**2, 0.0))
        known = near & (tangential < _MAX_TANGENTIAL * self._spacing)
        limit = _CROSSING * self._spacing
        front, behind = known & (height > limit), known & (height < -limit)
        crossed = [
            (front[:, lag:] & behind[:, :-lag]) | (behind[:, lag:] & front[:, :-lag])
            for lag in _LAGS
        ]
        return np.asarray(np.any([one.any(axis=1) for one in crossed], axis=0))
