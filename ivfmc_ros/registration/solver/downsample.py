# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Voxel downsampling of a view, in a grid that is aligned with the view's principal axes."""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.errors import GeometryError
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import View
from ivfmc_ros.registration.views.assemble import grid_normals
from ivfmc_ros.registration.views.assemble import spacing

# Target number of samples of a view. The bench row 'time against points' is measured with it.
MAX_SAMPLES = 20_000
# Points farther than this from the origin are refused, meters: no part on a table is that large,
# and voxel indices would overflow.
_MAX_RANGE = 100.0
# Where a view has no sigma at all, meters.
_DEFAULT_SIGMA = 1e-5


@dataclass(frozen=True, eq=False, kw_only=True)
class DownsampledView:
    """
    Means of the points of a view in voxels.

    points_xyz : (n, 3) meters
    sigma : (n,) meters, of the mean
    outward : (n, 3) direction to the seen side of the surface, of any length; 0 where not known
    order : (points,) indices of the view's valid points, sorted by sample
    starts : (n,) index into ``order`` at which a sample begins
    counts : (n,) points of each sample
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
        """(n,) index of one point of each sample among the valid points of the view."""
        return np.asarray(self.order[self.starts])

    def means(self, values: Floats) -> Floats:
        """Return (n, ...) means over each sample of (points, ...) values of the valid points."""
        if not len(self):
            return np.empty((0, *values.shape[1:]))
        sums = np.add.reduceat(values[self.order], self.starts, axis=0)
        return np.asarray(sums / self.counts.reshape(-1, *[1] * (values.ndim - 1)))


def downsample(view: View, voxel_size: float) -> DownsampledView:
    """
    Return the means of a view's points over voxels of ``voxel_size`` meters.

    The voxel grid is aligned with the view's own principal axes, so that the samples, and the
    result of a registration, do not depend on the pose from which it starts.

    :raises GeometryError: a point is farther than 100 m away, or only partly finite
    """
    valid = view.valid
    points = view.points_xyz[valid]
    if not np.isfinite(points).all():
        raise GeometryError(
            f'view {view.number}: has points of which some coordinates are not finite; an '
            'invalid point must be NaN in all three'
        )
    if len(points) and not np.abs(points).max() < _MAX_RANGE:
        raise GeometryError(
            f'view {view.number}: has points farther than {_MAX_RANGE:.0f} m from the table; '
            'coordinates must be in meters'
        )
    order, starts = _voxels(_in_principal_axes(points), voxel_size)
    counts = np.diff(np.append(starts, len(points)))
    grouped = DownsampledView(
        points_xyz=np.empty((len(starts), 3)),
        sigma=np.empty(len(starts)),
        outward=np.empty((len(starts), 3)),
        order=order,
        starts=starts,
        counts=counts,
    )
    return DownsampledView(
        points_xyz=grouped.means(points),
        sigma=grouped.means(fill_sigma(view)[valid]) / np.sqrt(counts),
        outward=grouped.means(np.nan_to_num(grid_normals(view)[valid])),
        order=order,
        starts=starts,
        counts=counts,
    )


def fill_sigma(view: View) -> Floats:
    """Return (rows, columns) sigma, meters; the view's median replaces values that are not > 0."""
    with np.errstate(invalid='ignore'):
        good = np.isfinite(view.sigma) & (view.sigma > 0)
    usual = float(np.median(view.sigma[good])) if good.any() else _DEFAULT_SIGMA
    return np.where(good, view.sigma, usual)


def common_voxel_size(views: list[View], max_samples: int = MAX_SAMPLES) -> float:
    """
    Return a voxel size, meters, at which every view has about ``max_samples`` samples or fewer.

    It is not below the median point spacing of the views; NaN if no view has a surface.
    """
    spacings = [spacing(view) for view in views]
    known = [one for one in spacings if np.isfinite(one) and one > 0]
    if not known:
        return float('nan')
    areas = [_area(view) for view in views]
    return max(float(np.median(known)), float(np.sqrt(max(areas) / max_samples)))


def _area(view: View) -> float:
    """Return the approximate surface area of a view, square meters."""
    points = view.points_xyz
    down = np.linalg.norm(np.diff(points, axis=0)[:, :-1], axis=2)
    right = np.linalg.norm(np.diff(points, axis=1)[:-1], axis=2)
    quads = (down * right)[np.isfinite(down * right)]
    # quads that span a gap are clipped
    return float(np.minimum(quads, 10 * np.median(quads)).sum()) if quads.size else 0.0


def _in_principal_axes(points: Floats) -> Floats:
    """Return (n, 3) points in their principal axes, each pointing towards the longer tail."""
    if len(points) < 2:
        return points
    centered = points - points.mean(axis=0)
    axes = np.linalg.eigh(centered.T @ centered)[1]
    along = centered @ axes
    return np.asarray(along * np.where((along * along * along).sum(axis=0) < 0.0, -1.0, 1.0))


def _voxels(points: Floats, voxel_size: float) -> tuple[Ints, Ints]:
    """Return the order that sorts (n, 3) points by voxel, and where each voxel begins in it."""
    if not len(points):
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
    voxel = np.floor((points - points.min(axis=0)) / voxel_size).astype(np.int64)
    shape = voxel.max(axis=0) + 1
    key = (voxel[:, 0] * shape[1] + voxel[:, 1]) * shape[2] + voxel[:, 2]
    order = np.argsort(key, kind='stable')
    starts = np.flatnonzero(np.diff(key[order], prepend=-1))
    return order, starts.astype(np.int64)
