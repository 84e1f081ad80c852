# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Straight line segments of profiles, for surfaces that are too narrow for surfels.

A surfel is fitted to neighbors in several profiles. The wall of a drilled hole may be crossed by
only three profiles two millimeters apart, but each of them has twenty points on it.
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
from ivfmc_ros.registration.solver.downsample import fill_sigma
from ivfmc_ros.registration.solver.surfels import Surfels

# Consecutive points of a segment, and the step from one segment to the next; 5 points fix a
# direction, and segments overlap by more than half.
_POINTS, _STEP = 5, 2
# Greatest rms distance of the points from their line, in sigmas of a point.
_STRAIGHT_SIGMAS = 2.5
# A segment lies on a surfel that is this near, within this distance of its plane (both in surfel
# spacings), and this parallel to it (cosine between direction and normal).
_SURFEL_DISTANCE, _PLANE_DISTANCE, _PARALLEL_COSINE = 2.0, 0.06, 0.2


@dataclass(frozen=True, eq=False, kw_only=True)
class LineSegments:
    """
    Straight segments of profiles.

    points_xyz : (n, 3) meters, their centers
    directions : (n, 3) unit vectors along the profile
    sight : (n, 3) unit vectors to the camera
    sigma : meters, 1 sigma of a measured point
    """

    points_xyz: Floats
    directions: Floats
    sight: Floats
    sigma: float

    def __len__(self) -> int:
        return len(self.points_xyz)

    def selected(self, index: Ints | Bools) -> 'LineSegments':
        """Return the segments of the given indices or mask."""
        return replace(
            self,
            points_xyz=self.points_xyz[index],
            directions=self.directions[index],
            sight=self.sight[index],
        )

    def transformed(self, T: Floats) -> 'LineSegments':
        """Return the segments transformed by a rigid (4, 4) matrix."""
        return replace(
            self,
            points_xyz=transforms.apply(T, self.points_xyz),
            directions=self.directions @ T[:3, :3].T,
            sight=self.sight @ T[:3, :3].T,
        )

    def without_surfels(self, surfels: Surfels, spacing: float) -> 'LineSegments':
        """Return the segments that lie on no surfel; spacing : of the surfels, meters."""
        if not len(self) or not len(surfels):
            return self
        distance, j = surfels.tree.query(
            self.points_xyz, k=3, distance_upper_bound=_SURFEL_DISTANCE * spacing, workers=1
        )
        j = np.minimum(j, len(surfels) - 1)
        normals = surfels.normals[j]
        offset = self.points_xyz[:, None] - surfels.points_xyz[j]
        in_plane = np.abs((offset * normals).sum(axis=2)) < _PLANE_DISTANCE * spacing
        parallel = np.abs((normals * self.directions[:, None]).sum(axis=2)) < _PARALLEL_COSINE
        return self.selected(~(np.isfinite(distance) & in_plane & parallel).any(axis=1))


def extract_line_segments(view: View, sight: Floats, max_gap: float) -> LineSegments:
    """
    Return the straight segments of a view's profiles.

    sight : (n, 3) from the view's valid points to the camera
    max_gap : meters, greatest distance of consecutive points of a segment
    """
    column, row = np.nonzero(view.valid.T)
    points = view.points_xyz[row, column]
    sigma = fill_sigma(view)[row, column]
    towards = np.full(view.points_xyz.shape, np.nan)
    towards[view.valid] = sight
    towards = towards[row, column]
    median_sigma = float(np.median(sigma)) if len(sigma) else 0.0
    if len(points) < _POINTS:
        none = np.empty((0, 3))
        return LineSegments(points_xyz=none, directions=none, sight=none, sigma=median_sigma)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    connected = (np.diff(column) == 0) & (steps < max_gap)
    complete = np.lib.stride_tricks.sliding_window_view(connected, _POINTS - 1).all(axis=1)
    first = np.flatnonzero(complete)[::_STEP]
    segments = points[first[:, None] + np.arange(_POINTS)]
    centers = segments.mean(axis=1)
    offsets = segments - centers[:, None]
    # principal axes of each segment; the two small eigenvalues are the distance from its line
    variances, axes = np.linalg.eigh(np.einsum('nki,nkj->nij', offsets, offsets) / _POINTS)
    straight = variances[:, :2].sum(axis=1) < (_STRAIGHT_SIGMAS * median_sigma) ** 2
    seen = towards[first + _POINTS // 2]
    return LineSegments(
        points_xyz=centers[straight],
        directions=axes[straight][:, :, 2],
        sight=(seen / np.linalg.norm(seen, axis=1, keepdims=True))[straight],
        sigma=median_sigma,
    )


def concatenate_segments(parts: Sequence[LineSegments]) -> LineSegments:
    """Return all segments in one; sigma is the median of theirs."""
    return LineSegments(
        points_xyz=np.concatenate([part.points_xyz for part in parts]),
        directions=np.concatenate([part.directions for part in parts]),
        sight=np.concatenate([part.sight for part in parts]),
        sigma=float(np.median([part.sigma for part in parts])),
    )
