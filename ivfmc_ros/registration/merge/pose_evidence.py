# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What speaks for a pose of one body on another, and what against it."""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.registration.merge.bodies import Body
from ivfmc_ros.registration.merge.nearest_grid import NearGrid

_ALIKE = 0.8
# Partners lie within so many patch spacings along the surface, and across it.
_ASIDE, _ACROSS = 1.2, 2.0
# A line of sight passes through a surface if it is so many spacings before and behind it,
# within a few steps.
_THROUGH, _LAGS = 0.5, (1, 2, 3)
# So many patches of a body are asked.
_ASKED = 12_000
# What contradicts is counted by cubes of this edge in which this share of the patches does, and
# two or more: neighbours err together.
_CUBE, _MUCH = 3.0, 0.3


@dataclass(frozen=True, eq=False, kw_only=True)
class Evidence:
    """
    Shares of the patches of both bodies.

    agree : lie on the other's surface, within the noise
    differ : lie beside it, clearly farther than the noise
    blocked : cannot have been seen, because the other's surface is in the way
    contrary : (cubes,) bool, which pieces of both bodies contradict
    """

    agree: float
    differ: float
    blocked: float
    contrary: Bools

    @property
    def against(self) -> float:
        """Share of what contradicts the pose."""
        return self.differ + self.blocked

    def worse_than(self, other: 'Evidence') -> float:
        """
        Return by how many sigmas more of the same pieces contradict this pose than another.

        McNemar's test: pieces that contradict both poses, or neither, tell nothing.
        """
        here = int(np.count_nonzero(self.contrary & ~other.contrary))
        there = int(np.count_nonzero(other.contrary & ~self.contrary))
        return (here - there) / float(np.sqrt(max(here + there, 1)))


class Skin:
    """
    A body whose surface can be asked what is near, or in the way.

    edge : metres, between its patches
    """

    def __init__(self, body: Body, edge: float) -> None:
        self.body = body
        self._edge = edge
        reach = float(np.hypot(_ASIDE, _ACROSS)) * edge
        self._grid = NearGrid.of(body.patches.points_xyz, edge / 2, reach)
        self._some = body.chosen(np.random.default_rng(0).permutation(len(body))[:_ASKED])
        cube = np.floor(self._some.patches.points_xyz / (_CUBE * edge)).astype(np.int64)
        self._cube = np.unique(cube, axis=0, return_inverse=True)[1].ravel()

    def evidence(self, onto: 'Skin', T: Floats, noise: float) -> Evidence:
        """
        Return what this body at T (onto_from_body) and the other say about each other.

        noise : metres, within which surfaces are the same
        """
        here = onto._asked(self._some.moved(T), noise)
        there = self._asked(onto._some.moved(transforms.invert(T)), noise)
        agree, differ, blocked = (here.mean(axis=1) + there.mean(axis=1)) / 2
        return Evidence(
            agree=float(agree),
            differ=float(differ),
            blocked=float(blocked),
            contrary=np.concatenate([self._contrary(here), onto._contrary(there)]),
        )

    def _contrary(self, answers: Bools) -> Bools:
        against = (answers[1] | answers[2]).astype(np.float64)
        size, much = np.bincount(self._cube), np.bincount(self._cube, weights=against)
        return np.asarray((much >= 2) & (much >= _MUCH * size))

    def _asked(self, other: Body, noise: float) -> Bools:
        """Return (3, n) which patches of the other agree, differ, are blocked."""
        points, normals = other.patches.points_xyz, other.patches.normals
        gap, facing, near = self._nearest(points)
        middle = normals + facing
        middle = middle / np.maximum(np.linalg.norm(middle, axis=1, keepdims=True), 1e-9)
        along = np.abs((gap * middle).sum(axis=1))
        aside = np.sqrt(np.maximum((gap**2).sum(axis=1) - along**2, 0.0))
        alike = (normals * facing).sum(axis=1) > _ALIKE
        beside = near & alike & (aside < _ASIDE * self._edge)
        agree = beside & (along < noise)
        differ = beside & ~agree & (along < _ACROSS * self._edge)
        return np.stack([agree, differ, self._blocks(other) & ~beside])

    def _nearest(self, points_xyz: Floats) -> tuple[Floats, Floats, Bools]:
        """Return the offset from the nearest patch, its normal, and whether there is one."""
        patches = self.body.patches
        j = self._grid.find(points_xyz)
        return points_xyz - patches.points_xyz[j], patches.normals[j], j >= 0

    def _blocks(self, other: Body) -> Bools:
        """Return which patches of the other the camera must have seen through this surface."""
        length = float(np.linalg.norm(np.ptp(self.body.patches.points_xyz, axis=0)))
        steps = self._edge * np.arange(0.0, length / self._edge)
        ray = other.patches.points_xyz[:, None] + steps[None, :, None] * other.sight[:, None]
        gap, facing, near = self._nearest(ray)
        height = (gap * facing).sum(axis=2)
        aside = np.sqrt(np.maximum((gap**2).sum(axis=2) - height**2, 0.0))
        known = near & (aside < _ASIDE * self._edge)
        limit = _THROUGH * self._edge
        front, behind = known & (height > limit), known & (height < -limit)
        crossed = [
            (front[:, lag:] & behind[:, :-lag]) | (behind[:, lag:] & front[:, :-lag])
            for lag in _LAGS
        ]
        return np.asarray(np.any([one.any(axis=1) for one in crossed], axis=0))
