# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Short straight pieces of profiles: what is known of faces that are too small for a patch.

A patch needs neighbours in several profiles. On the wall of a hole there may be three profiles
two millimetres apart, but on each of them twenty points.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import View
from ivfmc_ros.registration.solver.downsample import usable_sigma
from ivfmc_ros.registration.solver.surfels import Patches

# Points of a stroke, and how many farther the next one begins.
_POINTS, _NEXT = 5, 2
# A stroke is straight within so many sigmas of its points (rms).
_STRAIGHT = 2.5
# A stroke belongs to a patch that is so near, and off its plane by no more, in patch spacings.
_NEAR, _OFF = 2.0, 0.06
_ALONG = 0.2


@dataclass(frozen=True, eq=False, kw_only=True)
class Strokes:
    """
    Pieces of profiles.

    points_xyz : (n, 3) metres, their middles; ways : (n, 3) unit, along the profile
    sight : (n, 3) unit, to the camera; sigma : metres, of a point of theirs
    """

    points_xyz: Floats
    ways: Floats
    sight: Floats
    sigma: float

    def __len__(self) -> int:
        return len(self.points_xyz)

    def chosen(self, which: Ints | Bools) -> 'Strokes':
        """Return some of the strokes."""
        return replace(
            self,
            points_xyz=self.points_xyz[which],
            ways=self.ways[which],
            sight=self.sight[which],
        )

    def posed(self, T: Floats) -> 'Strokes':
        """Return the strokes moved by a rigid (4, 4) matrix."""
        return replace(
            self,
            points_xyz=transforms.apply(T, self.points_xyz),
            ways=self.ways @ T[:3, :3].T,
            sight=self.sight @ T[:3, :3].T,
        )

    def beside(self, patches: Patches, edge: float) -> 'Strokes':
        """Return those that lie on no patch; edge : metres, between patches."""
        if not len(self) or not len(patches):
            return self
        distance, j = patches.tree.query(
            self.points_xyz, k=3, distance_upper_bound=_NEAR * edge, workers=1
        )
        j = np.minimum(j, len(patches) - 1)
        normals = patches.normals[j]
        gap = self.points_xyz[:, None] - patches.points_xyz[j]
        flat = np.abs((gap * normals).sum(axis=2)) < _OFF * edge
        within = np.abs((normals * self.ways[:, None]).sum(axis=2)) < _ALONG
        return self.chosen(~(np.isfinite(distance) & flat & within).any(axis=1))


def strokes_of(view: View, sight: Floats, reach: float) -> Strokes:
    """
    Return the straight pieces of a view's profiles.

    sight : (n, 3) from the view's valid points to the camera; reach : metres, between points
    """
    column, row = np.nonzero(view.valid.T)
    points = view.points_xyz[row, column]
    sigma = usable_sigma(view)[row, column]
    towards = np.full(view.points_xyz.shape, np.nan)
    towards[view.valid] = sight
    towards = towards[row, column]
    usual = float(np.median(sigma)) if len(sigma) else 0.0
    if len(points) < _POINTS:
        return Strokes(
            points_xyz=np.empty((0, 3)), ways=np.empty((0, 3)), sight=np.empty((0, 3)), sigma=usual
        )
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    hangs = (np.diff(column) == 0) & (steps < reach)
    whole = np.lib.stride_tricks.sliding_window_view(hangs, _POINTS - 1).all(axis=1)
    first = np.flatnonzero(whole)[::_NEXT]
    pieces = points[first[:, None] + np.arange(_POINTS)]
    middle = pieces.mean(axis=1)
    spread = pieces - middle[:, None]
    size, axes = np.linalg.eigh(np.einsum('nki,nkj->nij', spread, spread) / _POINTS)
    straight = size[:, :2].sum(axis=1) < (_STRAIGHT * usual) ** 2
    seen = towards[first + _POINTS // 2]
    return Strokes(
        points_xyz=middle[straight],
        ways=axes[straight][:, :, 2],
        sight=(seen / np.linalg.norm(seen, axis=1, keepdims=True))[straight],
        sigma=usual,
    )


def strokes_together(parts: Sequence[Strokes]) -> Strokes:
    """Return all strokes in one."""
    return Strokes(
        points_xyz=np.concatenate([part.points_xyz for part in parts]),
        ways=np.concatenate([part.ways for part in parts]),
        sight=np.concatenate([part.sight for part in parts]),
        sigma=float(np.median([part.sigma for part in parts])),
    )
