# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A view thinned evenly over its surface, without losing what its points know together."""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.errors import GeometryError
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import View
from ivfmc_ros.registration.views.assemble import grid_normals
from ivfmc_ros.registration.views.assemble import spacing

# A view keeps about this many samples.
MOST_SAMPLES = 20_000
# Farther than this from the origin nothing stands on a table; voxels would overflow.
_FARTHEST = 100.0  # metres


@dataclass(frozen=True, eq=False, kw_only=True)
class Samples:
    """
    Means of the points in small cubes.

    points_xyz : (n, 3) metres; sigma : (n,) metres, of the mean
    outward : (n, 3) the side of the surface that was seen, of any length; 0 where not known
    order : (points,) the view's points, those of a sample side by side
    starts : (n,) where a sample begins in ``order``; counts : (n,) points of each
    """

    points_xyz: Floats
    sigma: Floats
    outward: Floats
    order: Ints
    starts: Ints
    counts: Ints

    def __len__(self) -> int:
        return len(self.points_xyz)

    @property
    def first(self) -> Ints:
        """(n,) a point of each sample, an index into the valid points of the view."""
        return np.asarray(self.order[self.starts])

    def means(self, values: Floats) -> Floats:
        """Return the mean over each sample of (points, ...) values of the valid points."""
        if not len(self):
            return np.empty((0, *values.shape[1:]))
        sums = np.add.reduceat(values[self.order], self.starts, axis=0)
        return np.asarray(sums / self.counts.reshape(-1, *[1] * (values.ndim - 1)))


def sample(view: View, edge: float) -> Samples:
    """
    Return the means of a view's points over cubes of ``edge`` metres.

    The cubes lie along the view's own principal axes, so that a view has the same samples
    wherever it stands, and a registration the same answer from wherever it starts.

    :raises GeometryError: a point is farther away than any table, or partly not a number
    """
    valid = view.valid
    points = view.points_xyz[valid]
    if not np.isfinite(points).all():
        raise GeometryError(
            f'view {view.number}: has points of which some coordinates are not finite; what is '
            'not measured is NaN in all three'
        )
    if len(points) and not np.abs(points).max() < _FARTHEST:
        raise GeometryError(
            f'view {view.number}: has points farther than {_FARTHEST:.0f} m from the table; '
            'coordinates are metres'
        )
    order, starts = _cubes(_in_own_frame(points), edge)
    counts = np.diff(np.append(starts, len(points)))
    grouped = Samples(
        points_xyz=np.empty((len(starts), 3)),
        sigma=np.empty(len(starts)),
        outward=np.empty((len(starts), 3)),
        order=order,
        starts=starts,
        counts=counts,
    )
    return Samples(
        points_xyz=grouped.means(points),
        sigma=grouped.means(usable_sigma(view)[valid]) / np.sqrt(counts),
        outward=grouped.means(np.nan_to_num(grid_normals(view)[valid])),
        order=order,
        starts=starts,
        counts=counts,
    )


def usable_sigma(view: View) -> Floats:
    """Return (rows, columns) sigma in metres with the median where it is not positive."""
    with np.errstate(invalid='ignore'):
        good = np.isfinite(view.sigma) & (view.sigma > 0)
    usual = float(np.median(view.sigma[good])) if good.any() else 1e-5
    return np.where(good, view.sigma, usual)


def common_edge(views: list[View], most: int = MOST_SAMPLES) -> float:
    """Return the edge of cubes, metres, that hold a point or more in every view; NaN if none."""
    edges = [spacing(view) for view in views]
    known = [edge for edge in edges if np.isfinite(edge) and edge > 0]
    if not known:
        return float('nan')
    areas = [_area(view) for view in views]
    return max(float(np.median(known)), float(np.sqrt(max(areas) / most)))


def _area(view: View) -> float:
    """Return about the surface that a view covers, square metres."""
    points = view.points_xyz
    down = np.linalg.norm(np.diff(points, axis=0)[:, :-1], axis=2)
    right = np.linalg.norm(np.diff(points, axis=1)[:-1], axis=2)
    quads = (down * right)[np.isfinite(down * right)]
    # a few long steps over a gap are no surface
    return float(np.minimum(quads, 10 * np.median(quads)).sum()) if quads.size else 0.0


def _in_own_frame(points: Floats) -> Floats:
    """Return (n, 3) points along their principal axes, each towards its longer tail."""
    if len(points) < 2:
        return points
    spread = points - points.mean(axis=0)
    axes = np.linalg.eigh(spread.T @ spread)[1]
    along = spread @ axes
    return np.asarray(along * np.where((along * along * along).sum(axis=0) < 0.0, -1.0, 1.0))


def _cubes(points: Floats, edge: float) -> tuple[Ints, Ints]:
    """Return the order that puts points of one cube side by side, and where cubes begin."""
    if not len(points):
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
    cube = np.floor((points - points.min(axis=0)) / edge).astype(np.int64)
    shape = cube.max(axis=0) + 1
    key = (cube[:, 0] * shape[1] + cube[:, 1]) * shape[2] + cube[:, 2]
    order = np.argsort(key, kind='stable')
    starts = np.flatnonzero(np.diff(key[order], prepend=-1))
    return order, starts.astype(np.int64)
